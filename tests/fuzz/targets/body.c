/* SPDX-License-Identifier: MIT */
/*
 * The bodies of all packets, and what lies in them: sensor tables, shown values. The frame is
 * right. What is decoded is encoded to the same bytes; a decoder that refuses writes nothing, but
 * for a WELCOME's table, which is left as it was or empty.
 * First byte: which; then for STATE and TELEMETRY a table.
 */
#include "../../../c_src/vs_body.h"
#include "../../../c_src/vs_packet.h"
#include "fuzz.h"

static const uint8_t key[VS_KEY_SIZE] = {1, 2, 3};
static struct vs_table table;
static union {
    struct vs_hello hello;
    struct vs_welcome welcome;
    struct vs_notice notice;
    struct vs_state state;
    struct vs_telemetry telemetry;
} out, untouched;

/* A copy that ends where the body ends, so that one byte too many is seen. */
static uint8_t exact[VS_PACKET_MAX];

static int decode(uint8_t type, const uint8_t *body, size_t len)
{
    switch (type) {
    case VS_HELLO:
        return vs_decode_hello(body, len, &out.hello);
    case VS_WELCOME:
        return vs_decode_welcome(body, len, &out.welcome);
    case VS_STATE:
        return vs_decode_state(&table, body, len, &out.state);
    case VS_TELEMETRY:
        return vs_decode_telemetry(&table, body, len, &out.telemetry);
    default:
        return vs_decode_notice(type, body, len, &out.notice);
    }
}

static int encode(struct vs_header *h, uint8_t *buf, size_t cap, size_t *len)
{
    switch (h->type) {
    case VS_HELLO:
        return vs_encode_hello(h, &out.hello, buf, cap, len);
    case VS_WELCOME:
        return vs_encode_welcome(h, &out.welcome, buf, cap, len);
    case VS_STATE:
        return vs_encode_state(h, &table, &out.state, buf, cap, len);
    case VS_TELEMETRY:
        return vs_encode_telemetry(h, &table, &out.telemetry, buf, cap, len);
    default:
        return vs_encode_notice(h, &out.notice, buf, cap, len);
    }
}

/* Encoding into every room that is too small must say so, and write no further. */
static void check_room(struct vs_header *h, size_t whole, size_t cap)
{
    uint8_t small[VS_PACKET_MAX];
    size_t len = 1;

    cap %= whole;
    memset(small, 0xA5, whole);
    CHECK(encode(h, small, cap, &len) == VS_ERR_SPACE && len == 0);
    for (; cap < whole; cap++)
        CHECK(small[cap] == 0xA5);
}

static void check_empty(const struct vs_table *emptied)
{
    static struct vs_table empty;

    vs_table_init(&empty);
    CHECK(memcmp(emptied, &empty, sizeof empty) == 0);
}

static void check_packet(uint8_t type, struct input *in)
{
    uint8_t again[VS_PACKET_MAX];
    struct vs_header h;
    struct vs_header opened;
    const uint8_t *body;
    size_t len = sizeof exact - VS_PACKET_MIN;
    size_t body_len;
    size_t whole = 0;
    const uint8_t *bytes = take_bytes(in, &len);
    uint8_t *at = exact + sizeof exact - len;

    if (len > 0)
        memcpy(at, bytes, len);
    memset(&out, 0x5A, sizeof out);
    if (decode(type, at, len) != VS_OK) {
        if (type == VS_WELCOME && out.welcome.table.count == 0) {
            check_empty(&out.welcome.table);
            memcpy(&out.welcome.table, &untouched.welcome.table, sizeof untouched.welcome.table);
        }
        CHECK(memcmp(&out, &untouched, sizeof out) == 0);
        return;
    }
    memset(&h, 0, sizeof h);
    h.type = type;
    h.key = key;
    h.session = 7;
    h.sequence = (uint32_t)len;
    if (len + VS_PACKET_MIN > vs_packet_limit(type)) {
        CHECK(encode(&h, again, sizeof again, &whole) == VS_ERR_SPACE);
        return;
    }
    CHECK(encode(&h, again, sizeof again, &whole) == VS_OK && whole == len + VS_PACKET_MIN);
    CHECK(len == 0 || memcmp(again + VS_HEADER_SIZE, at, len) == 0);
    CHECK(vs_packet_open(again, whole, key, &opened, &body, &body_len) == VS_OK);
    CHECK(opened.type == type && opened.session == 7 && body_len == len);
    CHECK(vs_packet_open(again, whole, NULL, &opened, &body, &body_len) == VS_ERR_TAG);
    again[len % whole] ^= (uint8_t)(1u << (len & 7));
    CHECK(vs_packet_open(again, whole, key, &opened, &body, &body_len) != VS_OK);
    check_room(&h, whole, len * 31);
}

static void check_table(const uint8_t *bytes, size_t size)
{
    uint8_t again[VS_TABLE_BYTES];
    struct vs_table copy;
    size_t len = 0;
    uint32_t i;

    if (vs_table_decode(&table, bytes, size) != VS_OK) {
        CHECK(table.count == 0 && table.sensor_bytes == 0 && table.actuator_bytes == 0);
        return;
    }
    CHECK(vs_table_encode(&table, again, sizeof again, &len) == VS_OK && len == size);
    CHECK(memcmp(again, bytes, size) == 0);
    CHECK(4 * table.sensors + table.sensor_bytes <= VS_SENSOR_BYTES);
    CHECK(table.actuator_bytes <= VS_ACTUATOR_BYTES);
    vs_table_init(&copy);
    for (i = 0; i < table.count; i++) {
        const struct vs_entry *e = &table.entries[i];

        CHECK(vs_table_find(&table, e->name) == (int)i);
        CHECK(e->size == e->count * (e->type[1] - '0'));
        CHECK(vs_table_add(&copy, e->id, e->direction, e->name, e->layout) == VS_OK);
    }
    CHECK(copy.hash == table.hash);
}

static void check_shown(const uint8_t *block, size_t len)
{
    uint8_t built[VS_SHOWN_MAX];
    uint8_t built_len = 0;
    char name[VS_SHOWN_NAME_MAX + 1];
    char text[VS_SHOWN_TEXT_MAX + 1];
    uint8_t kind = 0;
    float number = 0.0f;
    size_t at = 0;

    if (len > VS_SHOWN_MAX)
        return;
    while (vs_shown_next(block, len, &at, name, &kind, &number, text) == VS_OK) {
        CHECK(at <= len && strlen(name) <= VS_SHOWN_NAME_MAX);
        if (*name != '\0')
            CHECK(vs_shown_set(built, &built_len, name, number,
                               kind == VS_SHOWN_TEXT ? text : NULL) == VS_OK);
        CHECK(built_len <= len);
    }
}

/* What a controller does with its values: set again and again, and cleared of nothing. */
static void check_showing(struct input *in)
{
    uint8_t block[VS_SHOWN_MAX];
    uint8_t len = 0;

    while (in->left > 0) {
        char name[32];
        char text[64];
        uint8_t before = len;
        uint32_t is_text = take_u8(in) & 1;

        memset(name, 0, sizeof name);
        memset(text, 0, sizeof text);
        take_into(in, name, take_below(in, sizeof name));
        take_into(in, text, take_below(in, sizeof text));
        if (vs_shown_set(block, &len, name, 1.5f, is_text ? text : NULL) != VS_OK)
            CHECK(len == before);
        check_shown(block, len);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct input in = {data, size};
    uint32_t which = take_below(&in, 9);
    size_t len;

    memset(&untouched, 0x5A, sizeof untouched);
    vs_table_init(&table);
    if (which == 0)
        check_table(in.at, in.left);
    else if (which == 7)
        check_shown(in.at, in.left);
    else if (which == 8)
        check_showing(&in);
    else {
        if (which == VS_STATE || which == VS_TELEMETRY) {
            len = take_u8(&in);
            data = take_bytes(&in, &len);
            if (vs_table_decode(&table, data, len) != VS_OK)
                vs_table_init(&table);
        }
        check_packet((uint8_t)which, &in);
    }
    return 0;
}
