/* SPDX-License-Identifier: MIT */
/*
 * robot_steps.c - a robot's control steps on virtual time, for counting instructions:
 * the worker's and the guard's own code, with a host and a microcontroller that cost
 * next to nothing.
 *
 *     robot_steps host N     what the host does for N timesteps, to be subtracted
 *     robot_steps live N     the same, and a robot that lives through them
 *     robot_steps show N     the same, and in every step it shows SHOWN bytes
 *
 * In each timestep of 100 ms two datagrams come, as on a real link; the controller, the
 * one that is linked in, makes one step; the base, argos, is read and written; telemetry
 * leaves. What the kernel does for sockets and the serial line is not in it.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base_config.h"
#include "guard.h"
#include "loop.h"
#include "talk.h"
#include "../../c_src/epuck_argos.h"

#define MS UINT64_C(1000000)
#define TIMESTEP_MS 100
#define HALF_NS (50 * MS)
#define FRAME 12   /* [byte] that the microcontroller waits for */
#define GREETING 5 /* [byte] that it waits for after a reset: wake-up and configuration */
#define ANSWER 72  /* [byte] that it answers with */
#define SHOWN 208  /* [byte] four texts of 48, each with a name of one; robot.py knows it, too */

static struct vs_peer peer;
static struct vs_welcome welcome;
static struct vs_session session;
static struct vs_loop loop;
static struct vs_guard guard;
static struct vs_base base;
static struct vs_talk talk;
static union vs_controller_state state;
static struct vs_instant now = {1000 * MS, 1000 * MS};
static size_t wanted = FRAME;
static size_t taken;   /* of the microcontroller's frame */
static size_t waiting; /* of its answer */
static unsigned long steps;

static void fail(const char *why)
{
    fprintf(stderr, "robot_steps: %s\n", why);
    exit(1);
}

static uint64_t line_now_ns(void *context)
{
    (void)context;
    return now.base_ns;
}

/* Zeros at once, or silence until the deadline. */
static int line_read(void *context, uint8_t *buf, size_t cap, uint64_t deadline_ns)
{
    size_t len = waiting < cap ? waiting : cap;

    (void)context;
    if (len == 0 && deadline_ns > now.base_ns) {
        now.session_ns += deadline_ns - now.base_ns;
        now.base_ns = deadline_ns;
    }
    memset(buf, 0, len);
    waiting -= len;
    return (int)len;
}

static int line_write(void *context, const uint8_t *buf, size_t len, uint64_t deadline_ns)
{
    (void)context;
    (void)deadline_ns;
    if (len == FRAME && buf[EPUCK_ARGOS_RESET_AT] == EPUCK_ARGOS_RESET) {
        wanted = GREETING;
        return VS_OK;
    }
    taken += len;
    if (taken >= wanted) {
        taken -= wanted;
        wanted = FRAME;
        waiting = ANSWER;
    }
    return VS_OK;
}

static size_t make_state(uint32_t timestep, uint8_t *buf)
{
    struct vs_header header;
    struct vs_state said;
    size_t len;

    memset(&header, 0, sizeof header);
    memset(&said, 0, sizeof said);
    header.timestep = timestep;
    header.capture_ns = now.session_ns - 20 * MS;
    header.run = 1;
    said.wanted = VS_RUN;
    peer.udp_ns = now.session_ns; /* telemetry comes */
    if (vs_peer_send_state(&peer, &welcome.table, &header, &said, now.session_ns, buf,
                           VS_DATAGRAM_MAX, &len) != VS_OK)
        fail("no STATE");
    return len;
}

static void make_host(void)
{
    static const char params[] = "stop_probability=0.3\nspeed_cm_s=12\nwalk_s=8\n";

    vs_peer_init(&peer);
    vs_table_init(&welcome.table);
    if (vs_table_add(&welcome.table, 1, VS_SENSOR, "pollutant", "f4") != VS_OK)
        fail("no table");
    welcome.timestep_us = TIMESTEP_MS * 1000;
    welcome.seed = 5;
    welcome.params = params;
    welcome.params_len = sizeof params - 1;
    vs_peer_open(&peer, 7, welcome.table.hash, 1, now.session_ns);
}

/* Answers the HELLO that the session has given out. */
static size_t give_welcome(uint8_t packet[VS_PACKET_MAX])
{
    struct vs_header header;
    uint8_t answer[VS_KEY_SIZE];
    uint8_t down[VS_KEY_SIZE];
    uint8_t up[VS_KEY_SIZE];
    size_t len;

    memset(&header, 0, sizeof header);
    header.run = 1;
    vs_peer_stamp(&peer, now.session_ns, &header);
    vs_key_answer(session.config.key, session.hello_tag, answer);
    header.key = answer;
    if (vs_encode_welcome(&header, &welcome, packet, VS_PACKET_MAX, &len) != VS_OK)
        fail("no WELCOME");
    vs_key_session(session.config.key, session.hello_tag, packet + len - VS_TAG_SIZE, down, up);
    vs_peer_set_keys(&peer, down, up);
    return len;
}

/* The controller, and behind it one that shows. */
static void step_and_show(void *memory, struct vs_robot *robot)
{
    static const char *const names[] = {"a", "b", "c", "d"};
    size_t i;

    vs_controller.step(memory, robot);
    for (i = 0; i < sizeof names / sizeof names[0]; i++)
        vs_robot_show_text(robot, names[i], "every byte of this text is one that a page shows");
}

static void open_session(int showing)
{
    static struct vs_controller speaker;
    static const uint8_t nonce[VS_NONCE_SIZE] = {9};
    struct vs_session_config config;
    uint8_t packet[VS_PACKET_MAX];
    enum vs_event event;
    size_t used;
    size_t len;

    memset(&config, 0, sizeof config);
    config.tag = 23;
    config.keyed = 1;
    memset(config.key, 7, sizeof config.key);
    if (vs_session_init(&session, &config) != VS_OK)
        fail("no session");
    vs_session_connected(&session, nonce, now.session_ns);
    vs_session_tcp_out(&session, packet, sizeof packet, now.session_ns, &len);
    len = give_welcome(packet);
    if (vs_session_tcp_in(&session, packet, len, now.session_ns, &used, &event) != VS_OK ||
        event != VS_EV_OPEN)
        fail("the session does not open");
    speaker = vs_controller;
    speaker.step = step_and_show;
    vs_loop_init(&loop, &session, showing ? &speaker : &vs_controller, state.bytes);
    vs_loop_event(&loop, event, &now);
    talk.free = 1; /* reports only what changes: nothing, from now on */
}

static void find_base(void)
{
    static const struct vs_base_config nowhere = {NULL, "/nowhere", {"", ""}, 4, 115, 0.1f, {0, 0}};
    int tries = 0;

    base.ops = vs_bases[0];
    if (base.ops->open(&base, &nowhere) != VS_ERR_IO)
        fail("there is a base");
    base.io.now_ns = line_now_ns;
    base.io.read = line_read;
    base.io.write = line_write;
    while (vs_base_recover(&base) != VS_OK)
        if (++tries > 1000)
            fail("the base is not found");
    vs_guard_init(&guard, 1);
}

/* What the guard's process does when it wakes up. */
static void serve_base(void)
{
    enum vs_guard_action action;
    struct vs_guard_reply reply;

    while ((action = vs_guard_next(&guard, now.base_ns)) == VS_GUARD_EXCHANGE)
        vs_guard_done(&guard, vs_base_exchange(&base, &guard.command, &guard.reading),
                      now.base_ns);
    if (action != VS_GUARD_WAIT)
        fail("the base is lost");
    if (vs_guard_reply(&guard, &reply))
        vs_loop_reply(&loop, &reply, &now);
}

/* What the worker does when it wakes up. */
static void serve_worker(const uint8_t *packet, size_t len)
{
    struct vs_telemetry telemetry;
    struct vs_guard_request request;
    uint8_t out[VS_DATAGRAM_MAX];
    enum vs_event event;
    size_t out_len;

    if (len > 0 && vs_session_udp_in(&session, packet, len, now.session_ns, &event) == VS_OK)
        vs_loop_event(&loop, event, &now);
    vs_session_tick(&session, now.session_ns, &event);
    if (vs_loop_request(&loop, &now, &request))
        vs_guard_request(&guard, &request, now.base_ns);
    serve_base();
    vs_talk_cause(&talk, vs_loop_cause(&loop, &now), now.base_ns);
    if (vs_loop_telemetry(&loop, &now, &telemetry) == VS_TELL_NEWS)
        vs_session_telemetry(&session, &telemetry, now.session_ns, out, sizeof out, &out_len);
}

/* Lives until until_ns: wakes up when the daemon would. */
static void live(uint64_t until_ns, const uint8_t *packet, size_t len)
{
    serve_worker(packet, len);
    for (;;) {
        uint64_t wake_ns = vs_loop_wake_ns(&loop, &now);
        uint64_t other_ns = vs_guard_deadline_ns(&guard);

        wake_ns = wake_ns < other_ns ? wake_ns : other_ns;
        if (wake_ns >= until_ns)
            break;
        if (wake_ns > now.base_ns) {
            now.session_ns += wake_ns - now.base_ns;
            now.base_ns = wake_ns;
        }
        serve_worker(NULL, 0);
    }
    if (until_ns > now.base_ns) {
        now.session_ns += until_ns - now.base_ns;
        now.base_ns = until_ns;
    }
}

int main(int argc, char *argv[])
{
    int showing = argc == 3 && strcmp(argv[1], "show") == 0;
    int alive = showing || (argc == 3 && strcmp(argv[1], "live") == 0);
    long count = argc == 3 ? strtol(argv[2], NULL, 10) : 0;
    uint8_t packet[VS_DATAGRAM_MAX];
    long i;

    make_host();
    if (alive) {
        find_base();
        open_session(showing);
    }
    for (i = 0; i < 2 * count; i++) {
        uint64_t until_ns = now.base_ns + HALF_NS;
        size_t len = make_state((uint32_t)(i / 2 + 1), packet);

        if (alive) {
            live(until_ns, packet, len);
        } else {
            now.session_ns += until_ns - now.base_ns;
            now.base_ns = until_ns;
        }
    }
    if (showing && loop.robot.shown_len != SHOWN)
        fail("it shows something else");
    steps = loop.completed;
    printf("%lu\n", steps);
    return 0;
}
