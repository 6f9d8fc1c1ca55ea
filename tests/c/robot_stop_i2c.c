/* SPDX-License-Identifier: MIT */
/*
 * The guard's mind and the bases on an I2C bus on which one thing goes wrong, with any
 * transaction around the end of a motion: whatever ends it, the wheels rest within 450 ms
 * and for good. Prints the longest time that it took.
 */
#include "guard.h"
#include "robot_bus.h"

#define REST_NS (450 * MS)
#define STEP_NS (100 * MS)
#define EXPIRY_NS (400 * MS)
#define LIFE_NS (4000 * MS)
#define STUCK_NS (60 * MS) /* then the far end, or its watchdog, lets go of the line */

enum cause { HOLD, STOPPED_WORKER, ORPHANED, CLOSE, CAUSES };
enum fault { REFUSED, WRITE_FLIPPED, READ_FLIPPED, STUCK, RESET, FAULTS };

struct life {
    struct bus_world world;
    struct vs_guard guard;
    uint64_t cause_ns; /* wheels have no right to turn from then on */
    uint64_t rest_ns;  /* when they last came to rest */
    int turning;
};

static uint64_t longest_ns;

static void perform(struct life *l, enum vs_guard_action action)
{
    struct vs_base *base = &l->world.base;
    int result;

    if (action == VS_GUARD_EXCHANGE)
        result = vs_base_exchange(base, &l->guard.command, &l->guard.reading);
    else if (action == VS_GUARD_RECOVER)
        result = vs_base_recover(base);
    else
        result = base->ops->close(base);
    vs_guard_done(&l->guard, result, l->world.now_ns);
}

/* Lives until a time, the guard's own deadlines included. Returns 0 once it exited. */
static int live_until(struct life *l, uint64_t until_ns)
{
    struct vs_guard_reply reply;

    while (l->world.now_ns < until_ns) {
        enum vs_guard_action action = vs_guard_next(&l->guard, l->world.now_ns);
        uint64_t deadline_ns = vs_guard_deadline_ns(&l->guard);
        int turning;

        (void)vs_guard_reply(&l->guard, &reply);
        if (action == VS_GUARD_EXIT)
            return 0;
        if (action != VS_GUARD_WAIT)
            perform(l, action);
        else
            bus_pass(&l->world,
                     (deadline_ns < until_ns ? deadline_ns : until_ns) - l->world.now_ns);
        turning = !bus_at_rest(&l->world);
        if (l->turning && !turning)
            l->rest_ns = l->world.now_ns;
        l->turning = turning;
    }
    return 1;
}

static void ask(struct life *l, enum vs_guard_kind kind, int16_t speed)
{
    struct vs_guard_request request = {(uint32_t)kind, 1, {speed, (int16_t)-speed, 0, {0, {0}}},
                                       l->world.now_ns + EXPIRY_NS};

    while (!vs_guard_listens(&l->guard))
        live_until(l, l->world.now_ns + MS);
    vs_guard_request(&l->guard, &request, l->world.now_ns);
}

static void begin_life(struct life *l, const struct vs_base_ops *ops, uint32_t seed)
{
    int i;

    memset(l, 0, sizeof *l);
    bus_begin(&l->world, ops, seed);
    vs_guard_init(&l->guard, 0);
    live_until(l, l->world.now_ns + 500 * MS);
    for (i = 0; i < 3; i++) {
        ask(l, VS_GUARD_ACT, 500);
        live_until(l, l->world.now_ns + STEP_NS);
    }
    CHECK(!bus_at_rest(&l->world));
}

static void make(struct bus_world *w, enum fault fault, uint32_t at)
{
    if (fault == REFUSED)
        w->wires.faults.refuse = at;
    else if (fault == WRITE_FLIPPED)
        w->wires.faults.flip_write = at;
    else if (fault == READ_FLIPPED)
        w->wires.faults.flip_read = at;
    else if (fault == STUCK)
        w->wires.stuck = 1;
    else
        fw_york_reset(&w->york, w->now_ns / 1000);
    if (fault == STUCK)
        w->stuck_until_ns = w->now_ns + STUCK_NS;
    if (fault == RESET)
        fw_gctronic_reset(&w->gctronic, w->now_ns / 1000);
}

static void end_motion(struct life *l, enum cause cause)
{
    l->cause_ns = l->world.now_ns;
    if (cause == STOPPED_WORKER)
        l->cause_ns = vs_guard_deadline_ns(&l->guard);
    else if (cause == HOLD)
        ask(l, VS_GUARD_ACT, 0);
    else if (cause == ORPHANED)
        vs_guard_orphaned(&l->guard, l->world.now_ns);
    else
        ask(l, VS_GUARD_CLOSE, 0);
}

static void test(const struct vs_base_ops *ops, enum cause cause, enum fault fault, uint32_t at)
{
    struct life l;

    begin_life(&l, ops, at);
    if (at % 2 == 0) {
        make(&l.world, fault, at);
        ask(&l, VS_GUARD_SENSE, 0);
        live_until(&l, l.world.now_ns + at % 16 * MS);
    }
    end_motion(&l, cause);
    if (at % 2 == 1)
        make(&l.world, fault, at);
    live_until(&l, l.world.now_ns + LIFE_NS);
    bus_pass(&l.world, STEP_NS);
    CHECK(bus_at_rest(&l.world));
    if (cause == ORPHANED || cause == CLOSE)
        CHECK(l.guard.action == VS_GUARD_EXIT && l.guard.stopped);
    if (l.rest_ns <= l.cause_ns)
        return;
    CHECK(l.rest_ns < l.cause_ns + REST_NS);
    if (l.rest_ns - l.cause_ns > longest_ns)
        longest_ns = l.rest_ns - l.cause_ns;
}

int main(void)
{
    uint32_t at;
    int cause;
    int fault;

    for (cause = HOLD; cause < CAUSES; cause++) {
        for (fault = REFUSED; fault < FAULTS; fault++) {
            for (at = 1; at <= 60; at++) {
                test(&vs_base_gctronic, (enum cause)cause, (enum fault)fault, at);
                test(&vs_base_york, (enum cause)cause, (enum fault)fault, at);
            }
        }
    }
    printf("rest after at most %u ms\n", (unsigned int)(longest_ns / MS));
    return 0;
}
