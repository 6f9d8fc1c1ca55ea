/* SPDX-License-Identifier: MIT */
/*
 * The worker's mind and the guard's, millisecond by millisecond on virtual time, with a host, a
 * base and a guard that do what the input says. robot_life.c checks every millisecond: wheels turn
 * only at what the controller asked for, while the host wants it and is heard.
 */
#include "../../c/robot_life.h"
#include "../../c/robot_life.c"
#include "fuzz.h"

#define LIFE_MS 4000

static struct world w;

/* A guard that was replaced has stopped the wheels first. */
static void replace_guard(void)
{
    vs_guard_init(&w.guard, 1);
    w.answer_ns = 0;
    w.unapplied = 0;
    memset(&w.base, 0, sizeof w.base);
    vs_loop_guard_lost(&w.loop);
}

/* A STATE. */
static void hear(uint8_t what, uint8_t wanted, uint32_t runs)
{
    if (!w.session.open)
        return;
    w.session.run += runs;
    wish(&w, wanted);
    receive(&w, what & 16);
}

static void act(struct input *in, uint8_t what)
{
    switch (what & 15) {
    case 0:
        w.session.open = !w.session.open;
        if (w.session.open)
            w.telemetry_ns = w.now.base_ns;
        vs_loop_event(&w.loop, w.session.open ? VS_EV_OPEN : VS_EV_NONE, &w.now);
        w.session.timestep_ns = w.timestep_ns;
        break;
    case 1:
        hear(what, (uint8_t)take_below(in, 5), 0);
        break;
    case 2:
        hear(what, w.session.wanted, 1);
        break;
    case 3:
        replace_guard();
        break;
    case 4:
        w.fault_one_in = 1u + take_u8(in); /* what went wrong may still be mended later */
        break;
    case 5:
        w.session.offer += !w.session.open;
        break;
    case 6:
        vs_loop_event(&w.loop, take_u8(in) & 1 ? VS_EV_GOODBYE : VS_EV_UDP_LOST, &w.now);
        break;
    default:
        hear(what, w.session.wanted, 0);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const uint64_t timesteps_ms[] = {100, 100, 50, 20, 200};
    struct input in = {data, size};
    uint32_t lived = 0;

    begin(&w, 1u + take_u16(&in));
    w.timestep_ns = timesteps_ms[take_below(&in, 5)] * MS;
    if (take_u8(&in) & 1)
        w.now.session_ns = UINT64_MAX - take_u16(&in) * MS;
    w.fault_one_in = take_u8(&in);
    w.wished_ns = 1;
    while (in.left > 0 && lived < LIFE_MS) {
        uint32_t pass = take_u8(&in);

        act(&in, take_u8(&in));
        lived += 1 + pass;
        live_for(&w, (1 + pass) * MS);
    }
    return 0;
}
