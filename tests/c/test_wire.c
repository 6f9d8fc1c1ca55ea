/* SPDX-License-Identifier: MIT */
/* Golden vectors, truncations, bit flips and small buffers, under the sanitizers: every
 * buffer lives alone on the heap, so that one byte read or written too far is seen. */
#include <string.h>

#include "check.h"
#include "vs_bytes.h"
#include "wire_vectors.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

static uint8_t *heap_copy(const uint8_t *data, size_t len)
{
    uint8_t *copy = malloc(len > 0 ? len : 1);

    CHECK(copy != NULL);
    memcpy(copy, data, len);
    return copy;
}

static void make_table(const struct row *rows, size_t count, struct vs_table *table)
{
    size_t i;

    vs_table_init(table);
    for (i = 0; i < count; i++)
        CHECK(vs_table_add(table, rows[i].id, rows[i].direction, rows[i].name,
                           rows[i].layout) == VS_OK);
}

static int encode(const struct golden *g, uint8_t *buf, size_t cap, size_t *len)
{
    struct vs_table table;
    struct vs_welcome welcome;

    make_table(g->rows, g->row_count, &table);
    if (g->hello)
        return vs_encode_hello(&g->header, g->hello, buf, cap, len);
    if (g->notice)
        return vs_encode_notice(&g->header, g->notice, buf, cap, len);
    if (g->state)
        return vs_encode_state(&g->header, &table, g->state, buf, cap, len);
    if (g->telemetry)
        return vs_encode_telemetry(&g->header, &table, g->telemetry, buf, cap, len);
    welcome = *g->welcome;
    welcome.table = table;
    return vs_encode_welcome(&g->header, &welcome, buf, cap, len);
}

union message {
    struct vs_hello hello;
    struct vs_welcome welcome;
    struct vs_notice notice;
    struct vs_state state;
    struct vs_telemetry telemetry;
};

static int decode(uint8_t type, const struct vs_table *table, const uint8_t *body, size_t len,
                  union message *m)
{
    switch (type) {
    case VS_HELLO:
        return vs_decode_hello(body, len, &m->hello);
    case VS_WELCOME:
        return vs_decode_welcome(body, len, &m->welcome);
    case VS_STATE:
        return vs_decode_state(table, body, len, &m->state);
    case VS_TELEMETRY:
        return vs_decode_telemetry(table, body, len, &m->telemetry);
    default:
        return vs_decode_notice(type, body, len, &m->notice);
    }
}

/* Decodes a packet and encodes it again. */
static int again(const uint8_t *packet, size_t packet_len, const struct vs_table *table,
                 uint8_t *buf, size_t cap, size_t *len)
{
    struct vs_header h;
    union message m;
    const uint8_t *body;
    size_t body_len;
    int err = vs_packet_open(packet, packet_len, NULL, &h, &body, &body_len);

    if (err == VS_OK)
        err = decode(h.type, table, body, body_len, &m);
    if (err != VS_OK)
        return err;
    switch (h.type) {
    case VS_HELLO:
        return vs_encode_hello(&h, &m.hello, buf, cap, len);
    case VS_WELCOME:
        return vs_encode_welcome(&h, &m.welcome, buf, cap, len);
    case VS_STATE:
        return vs_encode_state(&h, table, &m.state, buf, cap, len);
    case VS_TELEMETRY:
        return vs_encode_telemetry(&h, table, &m.telemetry, buf, cap, len);
    default:
        return vs_encode_notice(&h, &m.notice, buf, cap, len);
    }
}

static void test_golden(const struct golden *g)
{
    uint8_t *buf = malloc(g->len);
    uint8_t *packet = heap_copy(g->packet, g->len);
    struct vs_table table;
    size_t len = 0;

    CHECK(buf != NULL);
    CHECK_FOR(g->name, encode(g, buf, g->len, &len) == VS_OK);
    CHECK_FOR(g->name, len == g->len && memcmp(buf, g->packet, len) == 0);
    memset(buf, 0xEE, g->len);
    make_table(g->rows, g->row_count, &table);
    CHECK_FOR(g->name, again(packet, g->len, &table, buf, g->len, &len) == VS_OK);
    CHECK_FOR(g->name, len == g->len && memcmp(buf, g->packet, len) == 0);
    free(packet);
    free(buf);
}

static void test_every_truncation_asks_for_more(const struct golden *g)
{
    size_t cut;

    for (cut = 0; cut < g->len; cut++) {
        uint8_t *packet = heap_copy(g->packet, cut);
        struct vs_header h;
        const uint8_t *body;
        size_t len = 0;
        int framed = vs_packet_length(packet, cut, &len);

        CHECK_FOR(g->name, vs_packet_open(packet, cut, NULL, &h, &body, &len) == VS_ERR_SHORT);
        CHECK_FOR(g->name, framed == (cut < VS_PREFIX_SIZE ? VS_ERR_SHORT : VS_OK));
        free(packet);
    }
}

/* vs_body.h: a body that is refused leaves the message alone, but for a WELCOME's table. */
static void test_every_short_body_leaves_the_message(const struct golden *g)
{
    static union message m, before;
    struct vs_table table;
    struct vs_header h;
    const uint8_t *body;
    size_t len, cut;

    make_table(g->rows, g->row_count, &table);
    CHECK_FOR(g->name, vs_packet_open(g->packet, g->len, NULL, &h, &body, &len) == VS_OK);
    memset(&before, 0x5A, sizeof before);
    for (cut = 0; cut < len; cut++) {
        uint8_t *part = heap_copy(body, cut);

        memcpy(&m, &before, sizeof m);
        CHECK_FOR(g->name, decode(h.type, &table, part, cut, &m) < 0);
        CHECK_FOR(g->name, memcmp(&m, &before, sizeof m) == 0);
        free(part);
    }
}

static void test_a_welcome_with_a_bad_table_has_none(const struct golden *g)
{
    uint8_t *packet = heap_copy(g->packet, g->len);
    struct vs_table *table = malloc(sizeof *table);
    static union message m, before;
    struct vs_header h;
    const uint8_t *body;
    size_t len, at;

    CHECK(table != NULL);
    CHECK_FOR(g->name, vs_packet_open(packet, g->len, NULL, &h, &body, &len) == VS_OK);
    at = (size_t)(body - packet) + VS_NONCE_SIZE + 10 + g->welcome->params_len + 2;
    packet[at]++; /* one entry more than there are */
    memset(&before, 0x5A, sizeof before);
    memcpy(&m, &before, sizeof m);
    CHECK_FOR(g->name, decode(VS_WELCOME, NULL, body, len, &m) < 0);
    vs_table_init(table);
    CHECK_FOR(g->name, memcmp(&m.welcome.table, table, sizeof *table) == 0);
    memcpy(&m.welcome.table, &before.welcome.table, sizeof *table);
    CHECK_FOR(g->name, memcmp(&m, &before, sizeof m) == 0);
    free(table);
    free(packet);
}

static void test_every_bit_flip_is_refused(const struct golden *g)
{
    uint8_t *packet = heap_copy(g->packet, g->len);
    size_t bit;

    for (bit = 0; bit < 8 * g->len; bit++) {
        struct vs_header h;
        const uint8_t *body;
        size_t len;

        packet[bit / 8] ^= (uint8_t)(1u << bit % 8);
        CHECK_FOR(g->name, vs_packet_open(packet, g->len, NULL, &h, &body, &len) < 0);
        packet[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
    free(packet);
}

static void test_every_small_buffer_is_refused(const struct golden *g)
{
    size_t cap;

    for (cap = 0; cap < g->len; cap += cap + 1 < g->len && cap > 80 ? 37 : 1) {
        uint8_t *buf = malloc(cap > 0 ? cap : 1);
        size_t len = 1;

        CHECK(buf != NULL);
        CHECK_FOR(g->name, encode(g, buf, cap, &len) == VS_ERR_SPACE && len == 0);
        free(buf);
    }
}

static void test_bad(const struct bad *b)
{
    uint8_t *packet = heap_copy(b->packet, b->len);
    uint8_t buf[VS_PACKET_MAX];
    struct vs_table table;
    size_t len;
    int err;

    make_table(b->rows, b->row_count, &table);
    err = again(packet, b->len, &table, buf, sizeof buf, &len);
    if (err != b->error)
        fprintf(stderr, "expected %s, got %s\n", vs_errname(b->error), vs_errname(err));
    CHECK_FOR(b->name, err == b->error);
    free(packet);
}

static void test_crc(void)
{
    /* The check value of CRC-32/ISO-HDLC in every catalogue of CRCs. */
    CHECK(vs_crc32((const uint8_t *)"123456789", 9) == 0xCBF43926);
    CHECK(vs_crc32((const uint8_t *)"", 0) == 0);
}

static void test_floats_are_ieee_754_single_little_endian(void)
{
    static const struct {
        float value;
        uint8_t bytes[4];
    } golden[] = {
        {1.0F, {0x00, 0x00, 0x80, 0x3F}},
        {-0.0F, {0x00, 0x00, 0x00, 0x80}},
        {0.3F, {0x9A, 0x99, 0x99, 0x3E}},
    };
    uint8_t cell[4];
    size_t i;

    for (i = 0; i < COUNT(golden); i++) {
        float read = vs_load_f4(golden[i].bytes);

        vs_store_f4(cell, golden[i].value);
        CHECK(memcmp(cell, golden[i].bytes, sizeof cell) == 0);
        CHECK(memcmp(&read, &golden[i].value, sizeof read) == 0);
    }
}

static void test_every_error_has_its_line(void)
{
    int err;

    for (err = -100; err <= VS_OK; err++) {
        int has_name = strcmp(vs_errname(err), "VS_ERR_?") != 0;
        int has_text = strcmp(vs_strerror(err), "unknown error") != 0;

        CHECK(has_name == has_text);
    }
    CHECK(strcmp(vs_errname(VS_ERR_SEQUENCE), "VS_ERR_SEQUENCE") == 0);
    CHECK(strcmp(vs_errname(1), "VS_ERR_?") == 0);
}

int main(void)
{
    size_t i;

    test_crc();
    test_floats_are_ieee_754_single_little_endian();
    test_every_error_has_its_line();
    for (i = 0; i < COUNT(goldens); i++) {
        test_golden(&goldens[i]);
        test_every_truncation_asks_for_more(&goldens[i]);
        test_every_short_body_leaves_the_message(&goldens[i]);
        if (goldens[i].welcome)
            test_a_welcome_with_a_bad_table_has_none(&goldens[i]);
        test_every_bit_flip_is_refused(&goldens[i]);
        test_every_small_buffer_is_refused(&goldens[i]);
    }
    for (i = 0; i < COUNT(bads); i++)
        test_bad(&bads[i]);
    return 0;
}
