/* SPDX-License-Identifier: MIT */
/*
 * The guard's mind, base_argos and the firmware's own code over a line that loses one byte,
 * any one around the end of a motion: whatever ends it, the wheels rest within 450 ms and
 * for good. Prints the longest time that it took.
 */
#include "guard.h"
#include "robot_world.h"

#define REST_NS (450 * MS)
#define STEP_NS (100 * MS)
#define EXPIRY_NS (400 * MS)
#define LIFE_NS (4000 * MS)

enum cause { HOLD, STOPPED_WORKER, ORPHANED, CLOSE, CAUSES };

struct life {
    struct world world;
    struct vs_guard guard;
    uint64_t cause_ns; /* wheels have no right to turn from then on */
    uint64_t rest_ns;  /* when they last came to rest */
    int turning;
};

static uint64_t longest_ns;

static int wheels_turn(const struct world *w)
{
    return w->fw.body.outputs.left_steps_s != 0 || w->fw.body.outputs.right_steps_s != 0;
}

static void perform(struct life *l, enum vs_guard_action action)
{
    struct vs_base *base = &l->world.base;
    int result = VS_OK;

    if (action == VS_GUARD_EXCHANGE)
        result = vs_base_exchange(base, &l->guard.command, &l->guard.reading);
    else if (action == VS_GUARD_RECOVER)
        result = vs_base_recover(base);
    else
        result = base->ops->close(base);
    vs_guard_done(&l->guard, result, l->world.now_ns);
}

static void look(struct life *l)
{
    int turning = wheels_turn(&l->world);

    if (l->turning && !turning)
        l->rest_ns = l->world.now_ns;
    l->turning = turning;
}

/* Lives until a time, the guard's own deadlines included. Returns 0 once it exited. */
static int live_until(struct life *l, uint64_t until_ns)
{
    struct vs_guard_reply reply;

    while (l->world.now_ns < until_ns) {
        enum vs_guard_action action = vs_guard_next(&l->guard, l->world.now_ns);
        uint64_t deadline_ns = vs_guard_deadline_ns(&l->guard);

        (void)vs_guard_reply(&l->guard, &reply);
        if (action == VS_GUARD_EXIT)
            return 0;
        if (action != VS_GUARD_WAIT)
            perform(l, action);
        else
            pass(&l->world, (deadline_ns < until_ns ? deadline_ns : until_ns) - l->world.now_ns);
        look(l);
    }
    return 1;
}

static void ask(struct life *l, enum vs_guard_kind kind, int16_t speed)
{
    struct vs_guard_request request = {(uint32_t)kind, 1, {speed, (int16_t)-speed, 0, {0, {0}}},
                                       l->world.now_ns + EXPIRY_NS};

    if (vs_guard_listens(&l->guard))
        vs_guard_request(&l->guard, &request, l->world.now_ns);
}

static void begin_life(struct life *l, uint32_t seed)
{
    int i;

    memset(l, 0, sizeof *l);
    begin(&l->world, seed);
    vs_guard_init(&l->guard, 0);
    live_until(l, l->world.now_ns + 500 * MS);
    for (i = 0; i < 3; i++) {
        ask(l, VS_GUARD_ACT, 500);
        live_until(l, l->world.now_ns + STEP_NS);
    }
    CHECK(wheels_turn(&l->world));
}

/* With HOLD the worker lives on and asks as loop.c does; it is told what fails. */
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

static void test(enum cause cause, uint32_t lose_written, uint32_t lose_read, uint32_t seed)
{
    struct life l;
    uint64_t end_ns;

    begin_life(&l, seed);
    if (seed % 2 == 0)
        ask(&l, VS_GUARD_SENSE, 0);
    l.world.lose_written = lose_written;
    l.world.lose_read = lose_read;
    if (seed % 2 == 0)
        live_until(&l, l.world.now_ns + STEP_NS / 2);
    end_motion(&l, cause);
    end_ns = l.world.now_ns + LIFE_NS;
    live_until(&l, end_ns);
    pass(&l.world, STEP_NS);
    CHECK(!wheels_turn(&l.world));
    if (cause == ORPHANED || cause == CLOSE)
        CHECK(l.guard.action == VS_GUARD_EXIT && l.guard.stopped);
    if (l.rest_ns <= l.cause_ns)
        return;
    CHECK(l.rest_ns < l.cause_ns + REST_NS);
    if (l.rest_ns - l.cause_ns > longest_ns)
        longest_ns = l.rest_ns - l.cause_ns;
}

int main(int argc, char *argv[])
{
    uint32_t seeds = argc > 1 ? (uint32_t)strtoul(argv[1], NULL, 10) : 4;
    uint32_t seed;
    uint32_t at;
    int cause;

    for (cause = HOLD; cause < CAUSES; cause++) {
        for (seed = 1; seed <= seeds; seed++) {
            for (at = 0; at <= 4 * EPUCK_ARGOS_ACTUATOR_LEN; at++)
                test((enum cause)cause, at, 0, seed);
            for (at = 1; at <= 2 * EPUCK_ARGOS_SENSOR_LEN; at++)
                test((enum cause)cause, 0, at, seed);
        }
    }
    printf("rest after at most %u ms\n", (unsigned int)(longest_ns / MS));
    return 0;
}
