/* SPDX-License-Identifier: MIT */
/*
 * The robot's session and a host that does anything: greets, or not, tags with the right key, a
 * wrong one or none, jumps, repeats, reflects, cuts packets anywhere. The model knows which packets
 * the true host has made: only those may be accepted, only in their order, and the robot wants
 * what the newest of them wants. First byte: whether the robot has a key.
 */
#include "../../../c_src/vs_packet.h"
#include "../../../c_src/vs_session.h"
#include "fuzz.h"

#define KEPT 8
#define STEPS 60
#define MS 1000000u

struct packet {
    uint8_t bytes[VS_PACKET_MAX];
    size_t len;
    uint32_t session; /* of the model: which greeting it was made after */
    uint32_t sequence;
    uint32_t run;
    uint8_t type;
    uint8_t wanted;
    uint8_t genuine; /* made by who has the session's key */
};

static struct world {
    struct vs_session s;
    struct input *in;
    uint64_t now_ns;
    uint8_t root[VS_KEY_SIZE];
    uint8_t hello_tag[VS_TAG_SIZE];
    uint8_t keys[5][VS_KEY_SIZE]; /* down, up, answer, the published one's answer, none's */
    struct vs_table table;        /* of the newest WELCOME */
    uint32_t session;             /* counts sessions that were opened */
    uint32_t number;              /* of the open one, on the wire */
    uint32_t sequence;            /* newest that was accepted */
    uint32_t run;
    uint8_t wanted;
    uint8_t greeted;
    uint32_t next;
    struct packet kept[KEPT];
} w;

static void check_counters(const struct vs_counters *c)
{
    CHECK(c->received == c->accepted + c->malformed + c->tag + c->body + c->foreign_type +
                             c->foreign_session + c->foreign_table + c->foreign_run + c->jump +
                             c->older + c->repeated);
}

/* What holds at any time. */
static void check_world(void)
{
    struct vs_value value;
    uint32_t i;
    uint32_t sum = 0;

    CHECK(w.s.open == (w.s.phase == VS_PHASE_OPEN));
    CHECK(w.s.wanted == w.wanted);
    CHECK(!w.s.open || w.s.peer.rx_sequence == w.sequence);
    CHECK(w.s.inbox_len <= sizeof w.s.inbox);
    CHECK(strlen(w.s.params) <= VS_PARAMS_ROOM);
    CHECK(w.s.fresh_ns <= w.now_ns && w.s.received_ns <= w.now_ns);
    check_counters(&w.s.peer.counters);
    for (i = 0; i < w.s.table.count; i++) {
        if (vs_session_value(&w.s, (int)i, &value) != VS_OK)
            continue;
        CHECK(value.known || value.capture_ns == 0);
        CHECK(value.data >= w.s.state.payload);
        CHECK(value.data + value.size <= w.s.state.payload + VS_SENSOR_BYTES);
        sum += value.data[0] + value.data[value.size - 1u];
        (void)vs_session_age_ns(&w.s, value.capture_ns, w.now_ns);
    }
    CHECK(sum <= VS_TABLE_MAX * 510u);
    CHECK(vs_session_value(&w.s, -1, &value) == VS_ERR_NOT_FOUND);
    CHECK(vs_session_value(&w.s, VS_TABLE_MAX, &value) == VS_ERR_NOT_FOUND);
}

static void on_event(enum vs_event event, const struct packet *p)
{
    CHECK(event != VS_EV_OPEN && event != VS_EV_STATE);
    if (event == VS_EV_REFUSED || event == VS_EV_GOODBYE)
        CHECK(p != NULL && p->genuine && w.s.phase == VS_PHASE_DOWN);
}

/* The robot has taken a STATE: this one. */
static void on_state(const struct packet *p)
{
    CHECK(p->genuine && p->type == VS_STATE && p->session == w.session);
    CHECK(p->sequence > w.sequence && p->sequence - w.sequence <= VS_SEQUENCE_JUMP);
    CHECK(p->run >= w.run && (w.run == 0 || p->run - w.run <= VS_RUN_JUMP));
    w.sequence = p->sequence;
    w.run = p->run;
    w.wanted = p->wanted;
}

static void on_open(const struct packet *p)
{
    CHECK(p->genuine && p->type == VS_WELCOME);
    vs_key_session(w.root, w.hello_tag, p->bytes + p->len - VS_TAG_SIZE, w.keys[0], w.keys[1]);
    CHECK(memcmp(w.keys[0], w.s.peer.rx_key, VS_KEY_SIZE) == 0);
    CHECK(memcmp(w.keys[1], w.s.peer.tx_key, VS_KEY_SIZE) == 0);
    w.session++;
    w.number = w.s.peer.session;
    w.sequence = w.run = w.wanted = 0;
    w.greeted = 0;
}

static void by_udp(const struct packet *p)
{
    enum vs_event event;
    int err = vs_session_udp_in(&w.s, p->bytes, p->len, w.now_ns, &event);

    CHECK((err == VS_OK) == (event == VS_EV_STATE));
    if (event == VS_EV_STATE)
        on_state(p);
    check_world();
}

/* A packet in pieces. What comes after one that broke the protocol is not looked at. */
static void by_tcp(const struct packet *p)
{
    size_t done = 0;
    size_t piece = 1 + take_u8(w.in) * 37u;

    while (done < p->len) {
        size_t len = p->len - done < piece ? p->len - done : piece;
        size_t used = 0;
        enum vs_event event;
        uint8_t phase = w.s.phase;
        int err = vs_session_tcp_in(&w.s, p->bytes + done, len, w.now_ns, &used, &event);

        CHECK(used <= len && (used > 0 || err != VS_OK));
        CHECK(err == VS_OK || w.s.phase == VS_PHASE_DOWN || phase == VS_PHASE_DOWN);
        done += used;
        if (event == VS_EV_OPEN)
            on_open(p);
        else if (event == VS_EV_STATE)
            on_state(p);
        else if (event == VS_EV_DOUBTED)
            CHECK(w.s.open || /* a goodbye that is not the host's */
                  (w.s.config.keyed && p->type == VS_REFUSE && w.s.phase == VS_PHASE_WAIT));
        else
            on_event(event, p);
        check_world();
        if (err != VS_OK)
            return;
    }
}

static struct packet *keep(void)
{
    struct packet *p = &w.kept[w.next++ % KEPT];

    memset(p, 0, sizeof *p);
    return p;
}

/* A packet's header, mostly as an honest host would have it. */
static struct vs_header make_header(const uint8_t **key, uint32_t *which)
{
    struct vs_header h;
    static const uint8_t chosen[8] = {0, 0, 0, 0, 1, 2, 3, 5};
    uint8_t how = take_u8(w.in);
    int32_t later = 1;

    memset(&h, 0, sizeof h);
    *which = chosen[how & 7];
    *key = *which < 5 ? w.keys[*which] : vs_key_published;
    h.session = how & 8 ? take_u32(w.in) : w.number;
    h.table_hash = how & 16 ? take_u32(w.in) : w.table.hash;
    if (how & 32)
        later = (int16_t)take_u16(w.in);
    h.sequence = w.sequence + (uint32_t)later;
    h.run = w.run + (how & 64 ? take_u8(w.in) - 20u : 0);
    h.echo_ns = how & 128 ? take_u64(w.in) : w.now_ns - take_u8(w.in) * MS;
    h.send_ns = w.now_ns + 5000000000u;
    h.capture_ns = h.send_ns - (uint64_t)(int64_t)(int16_t)take_u16(w.in) * MS;
    h.hold_us = take_u8(w.in);
    h.flags = take_u8(w.in) & 3;
    return h;
}

/* Whether the key is that of an answer. A robot without a key has the published one. */
static uint8_t is_answer(uint32_t which)
{
    return which == 0 || which == 2 || (which == 3 && !w.s.config.keyed);
}

static struct packet *make_welcome(void)
{
    static const char params[] = "speed=7\ncolour=red\n";
    struct packet *p = keep();
    struct vs_welcome welcome;
    struct vs_header h;
    const uint8_t *key;
    uint32_t which;
    uint32_t entries = take_below(w.in, 5);
    uint32_t i;

    memset(&welcome, 0, sizeof welcome);
    h = make_header(&key, &which);
    welcome.timestep_us = 1 + take_u16(w.in);
    welcome.params = params;
    welcome.params_len = (uint16_t)take_below(w.in, sizeof params);
    vs_table_init(&welcome.table);
    for (i = 0; i < entries; i++) {
        char name[2] = {(char)('a' + i), '\0'};
        char layout[] = "9*f4";

        layout[0] = (char)('1' + take_below(w.in, 9));
        (void)vs_table_add(&welcome.table, (uint8_t)i, i & 1, name, layout);
    }
    h.session = 1 + take_u8(w.in);
    h.table_hash = take_u8(w.in) == 255 ? 3 : welcome.table.hash;
    h.key = which == 0 ? w.keys[2] : key;
    p->type = VS_WELCOME;
    p->genuine = is_answer(which);
    CHECK(vs_encode_welcome(&h, &welcome, p->bytes, sizeof p->bytes, &p->len) == VS_OK);
    if (p->genuine && w.s.phase == VS_PHASE_WAIT)
        w.table = welcome.table;
    return p;
}

static struct packet *make_notice(void)
{
    struct packet *p = keep();
    struct vs_notice notice;
    const uint8_t *key;
    uint32_t which;
    struct vs_header h = make_header(&key, &which);

    memset(&notice, 0, sizeof notice);
    h.type = p->type = take_u8(w.in) & 1 ? VS_REFUSE : VS_GOODBYE;
    notice.code = take_u8(w.in);
    notice.text[0] = 'x';
    if (h.type == VS_REFUSE)
        h.session = 0;
    h.key = which != 0 ? key : w.keys[h.type == VS_REFUSE ? 2 : 0];
    p->genuine = h.type == VS_REFUSE ? is_answer(which) : (uint8_t)(which == 0);
    CHECK(vs_encode_notice(&h, &notice, p->bytes, sizeof p->bytes, &p->len) == VS_OK);
    return p;
}

static struct packet *make_state(void)
{
    struct packet *p = keep();
    struct vs_state state;
    const uint8_t *key;
    uint32_t which;
    struct vs_header h = make_header(&key, &which);

    memset(&state, 0, sizeof state);
    state.wanted = take_u8(w.in) % 5;
    take_into(w.in, state.payload, take_u8(w.in));
    h.key = which == 0 ? w.keys[0] : key;
    p->type = VS_STATE;
    p->genuine = which == 0;
    p->session = w.session;
    p->sequence = h.sequence;
    p->run = h.run;
    p->wanted = state.wanted;
    CHECK(vs_encode_state(&h, &w.table, &state, p->bytes, sizeof p->bytes, &p->len) == VS_OK);
    return p;
}

/* Bytes as they come, or a true packet with a bit that fell over. */
static struct packet *make_garbage(void)
{
    const struct packet *from = &w.kept[take_below(w.in, KEPT)];
    struct packet *p = keep();
    size_t len;

    /* One bit that fell over twice would be a true packet again. */
    if (take_u8(w.in) & 1 && from != p && from->type != 0 && from->len > 0) {
        *p = *from;
        len = take_u16(w.in) % (8 * p->len);
        p->bytes[len / 8] ^= (uint8_t)(1u << len % 8);
        p->type = 0;
    } else {
        p->len = take_u8(w.in);
        take_into(w.in, p->bytes, p->len);
    }
    p->genuine = 0;
    return p;
}

/* The robot greets; the host understands who, if it has the key. */
static void connect_robot(void)
{
    uint8_t nonce[VS_NONCE_SIZE] = {0};
    uint8_t hello[VS_GREETING_MAX];
    struct vs_header h;
    const uint8_t *body;
    size_t body_len;
    struct vs_hello said;
    size_t len = 0;

    nonce[0] = take_u8(w.in);
    memcpy(nonce + 8, &w.now_ns, sizeof w.now_ns); /* never twice the same */
    vs_session_connected(&w.s, nonce, 5);
    CHECK(vs_session_tcp_out(&w.s, hello, sizeof hello, w.now_ns, &len) == VS_OK && len > 0);
    CHECK(vs_packet_open(hello, len, w.root, &h, &body, &body_len) == VS_OK);
    CHECK(h.type == VS_HELLO && vs_decode_hello(body, body_len, &said) == VS_OK);
    memcpy(w.hello_tag, hello + len - VS_TAG_SIZE, VS_TAG_SIZE);
    vs_key_answer(w.root, w.hello_tag, w.keys[2]);
    vs_key_answer(vs_key_published, w.hello_tag, w.keys[3]);
    w.session++; /* what was made before is of no session any more */
    w.now_ns++;
}

/* TELEMETRY: under the session's key, and then it is thrown back. */
static void report(void)
{
    static struct vs_telemetry t;
    struct packet *p = keep();
    struct vs_header h;
    const uint8_t *body;
    size_t body_len;
    int err;

    memset(&t, 0, sizeof t);
    err = vs_session_telemetry(&w.s, &t, w.now_ns, p->bytes, sizeof p->bytes, &p->len);
    CHECK((err == VS_OK) == (w.s.peer.session != 0));
    if (err != VS_OK)
        return;
    CHECK(vs_packet_open(p->bytes, p->len, w.keys[1], &h, &body, &body_len) == VS_OK);
    CHECK(h.session == w.number && t.wanted == w.wanted);
    CHECK(vs_decode_telemetry(&w.s.table, body, body_len, &t) == VS_OK);
    p->type = VS_TELEMETRY;
    if (take_u8(w.in) & 1)
        by_udp(p);
}

static void leave(void)
{
    uint8_t bytes[VS_GREETING_MAX];
    size_t len;

    if (take_u8(w.in) & 1)
        vs_session_disconnected(&w.s);
    else if (vs_session_goodbye(&w.s, 0, "d\xc3\xa9j\xc3\xa0") == VS_OK) {
        CHECK(vs_session_tcp_out(&w.s, bytes, sizeof bytes, w.now_ns, &len) == VS_OK && len > 0);
        CHECK(w.s.phase == VS_PHASE_DOWN);
    }
    check_world();
}

static void pass_time(void)
{
    enum vs_event event;
    int i;

    w.now_ns += (uint64_t)take_u16(w.in) * (take_u8(w.in) & 1 ? 100000u : 1u);
    for (i = 0; i < 2; i++) {
        vs_session_tick(&w.s, w.now_ns, &event);
        CHECK(event == VS_EV_NONE || (i == 0 && (event == VS_EV_UDP_LOST || event == VS_EV_UDP_UP)));
    }
}

/* A packet that is kept goes one of both ways. */
static void deliver(const struct packet *p)
{
    if (take_u8(w.in) & 1)
        by_udp(p);
    else
        by_tcp(p);
}

static void step(void)
{
    switch (take_below(w.in, 11)) {
    case 0:
        connect_robot();
        break;
    case 1:
        by_tcp(make_welcome());
        break;
    case 2:
        deliver(make_notice());
        break;
    case 3:
    case 4:
        deliver(make_state());
        break;
    case 5:
        deliver(&w.kept[take_below(w.in, KEPT)]);
        break;
    case 6:
        deliver(make_garbage());
        break;
    case 7:
        report();
        break;
    case 8:
        leave();
        break;
    case 9:
        (void)make_state(); /* it comes later, or never */
        break;
    default:
        pass_time();
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct input in = {data, size};
    struct vs_session_config config;
    uint8_t how = take_u8(&in);
    int i;

    memset(&w, 0, offsetof(struct world, kept));
    for (i = 0; i < KEPT; i++)
        w.kept[i].len = w.kept[i].genuine = 0;
    memset(&config, 0, sizeof config);
    config.keyed = how & 1;
    config.clock_slewed = how >> 1 & 1;
    config.key[0] = 77;
    config.name[0] = 'r';
    memcpy(w.root, config.keyed ? config.key : vs_key_published, VS_KEY_SIZE);
    w.in = &in;
    w.now_ns = 1000000u * MS;
    CHECK(vs_session_init(&w.s, &config) == VS_OK);
    vs_table_init(&w.table);
    if (how & 4) {
        connect_robot();
        by_tcp(make_welcome());
    }
    for (i = 0; i < STEPS && in.left > 0; i++)
        step();
    return 0;
}
