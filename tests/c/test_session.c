/* SPDX-License-Identifier: MIT */
/* The robot's session under the sanitizers: any chunking, any bytes, packets mutilated
 * behind a tag that is right. */
#include <string.h>

#include "check.h"
#include "vs_bytes.h"
#include "vs_session.h"

#define MS 1000000ull
#define ROUNDS 20000

static uint64_t seed = 1;

/* xorshift64*: the same numbers on every machine. */
static uint32_t random_below(uint32_t limit)
{
    seed ^= seed >> 12;
    seed ^= seed << 25;
    seed ^= seed >> 27;
    return (uint32_t)((seed * 0x2545F4914F6CDD1Dull) >> 32) % limit;
}

/* The host's end, made of the same parts as Python's. */
struct host {
    struct vs_peer peer;
    struct vs_welcome welcome;
};

static void host_init(struct host *host)
{
    memset(host, 0, sizeof *host);
    vs_peer_init(&host->peer);
    vs_table_init(&host->welcome.table);
    CHECK(vs_table_add(&host->welcome.table, 1, VS_SENSOR, "pollutant", "f4") == VS_OK);
    CHECK(vs_table_add(&host->welcome.table, 2, VS_ACTUATOR, "drops", "u4") == VS_OK);
    host->welcome.timestep_us = 100000;
    host->welcome.seed = 5;
    host->welcome.params = "speed_cm_s=10\n";
    host->welcome.params_len = 14;
}

static const uint8_t *root_of(const struct vs_session *s)
{
    return s->config.keyed ? s->config.key : vs_key_published;
}

/* Answers the greeting that s has given out. */
static size_t give_welcome(struct host *host, const struct vs_session *s, uint32_t session,
                           uint8_t *buf, uint64_t now_ns)
{
    uint8_t answer[VS_KEY_SIZE];
    uint8_t down[VS_KEY_SIZE];
    uint8_t up[VS_KEY_SIZE];
    struct vs_header header;
    size_t len;

    memset(&header, 0, sizeof header);
    vs_peer_open(&host->peer, session, host->welcome.table.hash, 1, now_ns);
    vs_peer_stamp(&host->peer, now_ns, &header);
    vs_key_answer(root_of(s), s->hello_tag, answer);
    header.key = answer;
    CHECK(vs_encode_welcome(&header, &host->welcome, buf, VS_PACKET_MAX, &len) == VS_OK);
    vs_key_session(root_of(s), s->hello_tag, buf + len - VS_TAG_SIZE, down, up);
    vs_peer_set_keys(&host->peer, down, up);
    return len;
}

static size_t give_state(struct host *host, uint32_t timestep, uint8_t *buf, uint64_t now_ns)
{
    struct vs_header header;
    struct vs_state state;
    size_t len;

    memset(&header, 0, sizeof header);
    memset(&state, 0, sizeof state);
    header.timestep = timestep;
    header.capture_ns = timestep * 100 * MS;
    state.wanted = VS_RUN;
    vs_store_f4(state.payload, 1.0f);
    CHECK(vs_peer_send_state(&host->peer, &host->welcome.table, &header, &state, now_ns, buf,
                             VS_DATAGRAM_MAX, &len) == VS_OK);
    return len;
}

static size_t give_goodbye(struct host *host, uint8_t *buf)
{
    struct vs_header header;
    struct vs_notice notice = {VS_BYE_END, "done"};
    size_t len;

    memset(&header, 0, sizeof header);
    vs_peer_stamp(&host->peer, 1, &header);
    header.type = VS_GOODBYE;
    CHECK(vs_encode_notice(&header, &notice, buf, VS_PACKET_MAX, &len) == VS_OK);
    return len;
}

static void robot_init(struct vs_session *s)
{
    struct vs_session_config config;

    memset(&config, 0, sizeof config);
    strcpy(config.name, "robot");
    config.tag = 23;
    CHECK(vs_session_init(s, &config) == VS_OK);
}

static void robot_greets(struct vs_session *s, uint64_t now_ns)
{
    static const uint8_t nonce[VS_NONCE_SIZE] = {9};
    uint8_t hello[VS_GREETING_MAX];
    size_t len;

    vs_session_connected(s, nonce, 60);
    CHECK(vs_session_tcp_out(s, hello, sizeof hello, now_ns, &len) == VS_OK && len > 0);
}

/* Feeds a stream in chunks; writes the events as digits. */
static void feed(struct vs_session *s, const uint8_t *stream, size_t len, size_t chunk,
                 char *events)
{
    size_t at = 0;

    while (at < len) {
        size_t size = chunk < len - at ? chunk : len - at;
        uint8_t *bytes = malloc(size);
        enum vs_event event;
        size_t used;

        CHECK(bytes != NULL);
        memcpy(bytes, stream + at, size);
        CHECK(vs_session_tcp_in(s, bytes, size, 5 * MS, &used, &event) == VS_OK);
        CHECK(used > 0 && used <= size);
        if (event != VS_EV_NONE)
            *events++ = (char)('0' + event);
        at += used;
        free(bytes);
    }
    *events = '\0';
}

static void test_any_chunking_gives_the_same_events(void)
{
    static const size_t chunks[] = {1, 2, 3, 7, 8, 9, 55, 76, 77, 200, 100000};
    uint8_t stream[VS_PACKET_MAX + 5 * VS_DATAGRAM_MAX];
    struct vs_session s;
    struct host host;
    size_t len;
    size_t i;

    host_init(&host);
    robot_init(&s);
    robot_greets(&s, 1); /* the same greeting as in each round below */
    len = give_welcome(&host, &s, 77, stream, 1);
    for (i = 1; i <= 3; i++)
        len += give_state(&host, (uint32_t)i, stream + len, 1);
    len += give_goodbye(&host, stream + len);
    for (i = 0; i < sizeof chunks / sizeof chunks[0]; i++) {
        char events[16];

        robot_init(&s);
        robot_greets(&s, 1);
        feed(&s, stream, len, chunks[i], events);
        CHECK_FOR(events, strcmp(events, "12224") == 0);
        CHECK(strcmp(s.notice.text, "done") == 0);
    }
}

static void check_bounds(const struct vs_session *s)
{
    const struct vs_counters *c = &s->peer.counters;

    CHECK(s->inbox_len < VS_PACKET_MAX);
    CHECK(s->wanted <= VS_STOP);
    CHECK(c->received == c->accepted + c->malformed + c->tag + c->body + c->foreign_type +
                             c->foreign_session + c->foreign_table + c->foreign_run + c->jump +
                             c->older + c->repeated);
}

/* Some bytes changed, sometimes cut, the tag often made right again. */
static size_t mutilate(const uint8_t *key, uint8_t *packet, size_t len)
{
    uint32_t changes = 1 + random_below(4);

    while (changes-- > 0)
        packet[random_below((uint32_t)len)] = (uint8_t)random_below(256);
    if (random_below(4) == 0)
        len = VS_PACKET_MIN + random_below((uint32_t)len - VS_PACKET_MIN + 1);
    if (random_below(8) != 0) {
        packet[6] = (uint8_t)len;
        packet[7] = (uint8_t)(len >> 8);
        vs_tag_make(key, packet, len - VS_TAG_SIZE, packet + len - VS_TAG_SIZE);
    }
    return len;
}

static void feed_mutilated(struct vs_session *s, uint8_t *packet, size_t len, uint64_t now_ns)
{
    uint8_t *alone = malloc(len);
    enum vs_event event;
    size_t at = 0;

    CHECK(alone != NULL);
    memcpy(alone, packet, len);
    if (random_below(2)) {
        (void)vs_session_udp_in(s, alone, len, now_ns, &event);
    } else {
        size_t used = 1;

        while (at < len && used > 0) {
            if (vs_session_tcp_in(s, alone + at, len - at, now_ns, &used, &event) < 0) {
                CHECK(s->phase == VS_PHASE_DOWN);
                break;
            }
            CHECK(used > 0);
            at += used;
        }
    }
    free(alone);
}

static void test_mutilated_packets_do_no_harm(void)
{
    uint8_t packet[VS_PACKET_MAX];
    struct vs_session s;
    struct host host;
    uint32_t i;

    host_init(&host);
    robot_init(&s);
    for (i = 1; i <= ROUNDS; i++) {
        uint64_t now_ns = i * MS;
        uint8_t key[VS_KEY_SIZE];
        struct vs_value value;
        size_t len;

        if (s.phase == VS_PHASE_DOWN)
            robot_greets(&s, now_ns);
        if (s.phase == VS_PHASE_WAIT || random_below(64) == 0) {
            vs_key_answer(vs_key_published, s.hello_tag, key);
            len = give_welcome(&host, &s, i, packet, now_ns);
        } else {
            memcpy(key, s.peer.rx_key, VS_KEY_SIZE);
            len = give_state(&host, i, packet, now_ns);
        }
        if (random_below(3) != 0)
            len = mutilate(key, packet, len);
        feed_mutilated(&s, packet, len, now_ns);
        check_bounds(&s);
        if (vs_session_value(&s, (int)random_below(34) - 1, &value) == VS_OK)
            CHECK(value.data >= s.state.payload &&
                  value.data + value.size <= s.state.payload + VS_SENSOR_BYTES);
        (void)vs_session_age_ns(&s, s.capture_ns, now_ns);
    }
    CHECK(s.peer.counters.accepted > ROUNDS / 100);
    CHECK(s.peer.counters.tag + s.peer.counters.body > ROUNDS / 100);
}

static void test_random_bytes_are_one_named_error(void)
{
    uint8_t bytes[64];
    struct vs_session s;
    uint32_t i;
    size_t k;

    robot_init(&s);
    for (i = 0; i < ROUNDS; i++) {
        enum vs_event event;
        size_t used;
        int err;

        robot_greets(&s, 1);
        for (k = 0; k < sizeof bytes; k++)
            bytes[k] = (uint8_t)random_below(256);
        err = vs_session_tcp_in(&s, bytes, sizeof bytes, 1, &used, &event);
        CHECK(err <= VS_OK && strcmp(vs_errname(err), "VS_ERR_?") != 0);
        CHECK(event == VS_EV_NONE);
        check_bounds(&s);
    }
}

/* A robot that has a key, and a host that has another one, or none. */
static void robot_with_key(struct vs_session *s, uint8_t key)
{
    robot_init(s);
    s->config.keyed = 1;
    memset(s->config.key, key, VS_KEY_SIZE);
    robot_greets(s, 1);
}

static enum vs_event take(struct vs_session *s, const uint8_t *packet, size_t len, int *err)
{
    enum vs_event event;
    size_t used;

    *err = vs_session_tcp_in(s, packet, len, 2, &used, &event);
    return event;
}

static void test_only_a_host_with_its_key_is_believed(void)
{
    uint8_t packet[VS_PACKET_MAX];
    struct vs_session s, impostor;
    struct host host;
    int err;
    size_t len;

    host_init(&host);
    robot_with_key(&impostor, 2);
    robot_with_key(&s, 1);
    memcpy(impostor.hello_tag, s.hello_tag, VS_TAG_SIZE); /* it knows what was on the air */
    len = give_welcome(&host, &impostor, 7, packet, 1);
    CHECK(take(&s, packet, len, &err) == VS_EV_NONE && err == VS_ERR_TAG && !s.open);
    robot_greets(&s, 1);
    impostor.config.keyed = 0;
    len = give_welcome(&host, &impostor, 7, packet, 1);
    CHECK(take(&s, packet, len, &err) == VS_EV_NONE && err == VS_ERR_TAG && !s.open);
    robot_greets(&s, 1);
    len = give_welcome(&host, &s, 7, packet, 1);
    CHECK(take(&s, packet, len, &err) == VS_EV_OPEN && err == VS_OK && s.open);
}

static void test_no_answer_fits_a_later_greeting(void)
{
    static const uint8_t other[VS_NONCE_SIZE] = {8};
    uint8_t packet[VS_PACKET_MAX];
    uint8_t hello[VS_GREETING_MAX];
    struct vs_session s;
    struct host host;
    int err;
    size_t hello_len;
    size_t len;

    host_init(&host);
    robot_with_key(&s, 1);
    len = give_welcome(&host, &s, 7, packet, 1);
    vs_session_connected(&s, other, 60);
    CHECK(vs_session_tcp_out(&s, hello, sizeof hello, 1, &hello_len) == VS_OK);
    CHECK(take(&s, packet, len, &err) == VS_EV_NONE && err == VS_ERR_TAG);
}

static size_t give_refusal(const uint8_t *root, const struct vs_session *s, uint8_t *buf)
{
    struct vs_notice notice = {VS_REFUSE_TAG_UNKNOWN, "no such tag"};
    uint8_t answer[VS_KEY_SIZE];
    struct vs_header header;
    size_t len;

    memset(&header, 0, sizeof header);
    vs_key_answer(root, s->hello_tag, answer);
    header.key = answer;
    header.type = VS_REFUSE;
    CHECK(vs_encode_notice(&header, &notice, buf, VS_PACKET_MAX, &len) == VS_OK);
    return len;
}

static void test_a_refusal_that_anybody_may_have_made_ends_nothing(void)
{
    uint8_t packet[VS_PACKET_MAX];
    struct vs_session s;
    struct host host;
    int err;
    size_t len;

    host_init(&host);
    robot_with_key(&s, 1);
    len = give_refusal(vs_key_published, &s, packet);
    CHECK(take(&s, packet, len, &err) == VS_EV_DOUBTED && err == VS_OK);
    CHECK(strcmp(s.notice.text, "no such tag") == 0 && s.phase == VS_PHASE_WAIT);
    len = give_welcome(&host, &s, 7, packet, 1);
    CHECK(take(&s, packet, len, &err) == VS_EV_OPEN && err == VS_OK);
    robot_greets(&s, 1);
    len = give_refusal(s.config.key, &s, packet);
    CHECK(take(&s, packet, len, &err) == VS_EV_REFUSED && err == VS_OK);
}

static void test_an_end_that_anybody_may_have_made_ends_nothing(void)
{
    uint8_t packet[VS_PACKET_MAX];
    struct vs_header h;
    struct vs_notice bye;
    struct vs_session s;
    struct host host;
    int err;
    int forged;
    size_t len;

    host_init(&host);
    robot_with_key(&s, 1);
    len = give_welcome(&host, &s, 7, packet, 1);
    CHECK(take(&s, packet, len, &err) == VS_EV_OPEN && err == VS_OK);
    memset(&bye, 0, sizeof bye);
    bye.code = VS_BYE_END;
    strcpy(bye.text, "go home");
    len = give_refusal(vs_key_published, &s, packet);
    CHECK(take(&s, packet, len, &err) == VS_EV_DOUBTED && err == VS_OK && s.open);
    for (forged = 1; forged >= 0; forged--) {
        memset(&h, 0, sizeof h);
        vs_peer_stamp(&host.peer, 5, &h);
        h.type = VS_GOODBYE;
        if (forged)
            h.key = vs_key_published;
        CHECK(vs_encode_notice(&h, &bye, packet, sizeof packet, &len) == VS_OK);
        CHECK(take(&s, packet, len, &err) == (forged ? VS_EV_DOUBTED : VS_EV_GOODBYE));
        CHECK(err == VS_OK && s.open == forged);
        CHECK(s.peer.counters.tag == 2 && s.peer.counters.received == 2);
    }
}

static void test_nothing_is_left_of_what_was_there_before(void)
{
    struct vs_session s;

    memset(&s, 0xA5, sizeof s);
    robot_init(&s);
    CHECK(s.params[0] == '\0' && !s.open && s.run == 0 && s.wanted == 0);
}

/* The host would refuse a text of two lines, and the goodbye with it. */
static void test_what_a_goodbye_says_is_one_line_that_fits(void)
{
    char text[VS_TEXT_MAX + 2];
    uint8_t packet[VS_PACKET_MAX];
    struct vs_session s;
    struct host host;
    int err;

    host_init(&host);
    robot_with_key(&s, 1);
    CHECK(vs_session_goodbye(&s, VS_BYE_END, "over") == VS_ERR_STATE);
    CHECK(take(&s, packet, give_welcome(&host, &s, 7, packet, 1), &err) == VS_EV_OPEN);
    CHECK(vs_session_goodbye(&s, VS_BYE_END, "over\nand out") == VS_OK);
    CHECK(strcmp(s.notice.text, "over") == 0);
    memset(text, 'x', sizeof text - 1);
    text[sizeof text - 1] = '\0';
    memcpy(text + VS_TEXT_MAX - 1, "\xC3\xA9", 2); /* the cut halves it */
    CHECK(vs_session_goodbye(&s, VS_BYE_END, text) == VS_OK);
    CHECK(strlen(s.notice.text) == VS_TEXT_MAX - 1);
}

/* Its field ends after 71 minutes. */
static void test_an_echo_that_was_held_too_long_is_none(void)
{
    const uint64_t most_ns = UINT64_C(1000) * UINT32_MAX;
    uint8_t packet[VS_PACKET_MAX];
    struct vs_header header;
    struct vs_session s;
    struct host host;
    int err;

    host_init(&host);
    robot_with_key(&s, 1);
    CHECK(take(&s, packet, give_welcome(&host, &s, 7, packet, 1), &err) == VS_EV_OPEN);
    vs_peer_stamp(&s.peer, s.peer.rx_ns + most_ns, &header);
    CHECK(header.echo_ns == s.peer.rx_send_ns && header.echo_ns != 0);
    CHECK(header.hold_us == UINT32_MAX);
    vs_peer_stamp(&s.peer, s.peer.rx_ns + most_ns + 1000, &header);
    CHECK(header.echo_ns == 0 && header.hold_us == 0);
}

/* Both with the right keys: one sends what is too far ahead, and the other goes on hearing. */
static void test_no_packet_makes_a_peer_deaf(void)
{
    uint8_t packet[VS_PACKET_MAX];
    struct vs_session s;
    struct host host;
    enum vs_event event;
    int err;
    size_t len;

    host_init(&host);
    robot_with_key(&s, 1);
    len = give_welcome(&host, &s, 7, packet, 1);
    CHECK(take(&s, packet, len, &err) == VS_EV_OPEN);
    len = give_state(&host, 1, packet, 1);
    CHECK(vs_session_udp_in(&s, packet, len, 2, &event) == VS_OK);
    host.peer.tx_sequence = 1 + VS_SEQUENCE_JUMP;
    len = give_state(&host, 2, packet, 1);
    CHECK(vs_session_udp_in(&s, packet, len, 2, &event) == VS_ERR_JUMP && event == VS_EV_NONE);
    host.peer.tx_sequence = VS_SEQUENCE_JUMP;
    len = give_state(&host, 2, packet, 1);
    CHECK(vs_session_udp_in(&s, packet, len, 2, &event) == VS_OK && event == VS_EV_STATE);
    CHECK(s.peer.counters.jump == 1 && s.peer.counters.accepted == 2);
}

int main(void)
{
    test_only_a_host_with_its_key_is_believed();
    test_no_answer_fits_a_later_greeting();
    test_a_refusal_that_anybody_may_have_made_ends_nothing();
    test_an_end_that_anybody_may_have_made_ends_nothing();
    test_nothing_is_left_of_what_was_there_before();
    test_what_a_goodbye_says_is_one_line_that_fits();
    test_an_echo_that_was_held_too_long_is_none();
    test_no_packet_makes_a_peer_deaf();
    test_any_chunking_gives_the_same_events();
    test_mutilated_packets_do_no_harm();
    test_random_bytes_are_one_named_error();
    return 0;
}
