/* SPDX-License-Identifier: MIT */
/*
 * The guard's mind and the bases, with the firmware's own code at the far end, while one
 * thing goes wrong around the end of a motion: a serial line loses any one byte, an I2C bus
 * fails with any one transaction. Whatever ends the motion, the wheels rest within 450 ms
 * and for good. Prints the longest time that it took.
 */
#include "guard.h"
#include "robot_bus.h"
#include "robot_world.h"

#define REST_NS (450 * MS)
#define STEP_NS (100 * MS)
#define EXPIRY_NS (400 * MS)
#define LIFE_NS (4000 * MS)
#define STUCK_NS (60 * MS) /* then the far end, or its watchdog, lets go of the line */
#define SEEDS 4            /* of a serial line */
#define TRANSACTIONS 60    /* of a bus */

enum cause { HOLD, STOPPED_WORKER, ORPHANED, CLOSE, CAUSES };
enum fault { REFUSED, WRITE_FLIPPED, READ_FLIPPED, STUCK, RESET, FAULTS, WRITE_LOST, READ_LOST };

/* A robot in the one world or in the other. */
struct life {
    struct world line;
    struct bus_world bus;
    struct vs_base *base;
    const struct fw_outputs *wheels;
    uint64_t *now_ns;
    struct vs_guard guard;
    uint64_t cause_ns; /* wheels have no right to turn from then on */
    uint64_t rest_ns;  /* when they last came to rest */
    int turning;
};

static uint64_t longest_ns;

static int wheels_turn(const struct life *l)
{
    return l->wheels->left_steps_s != 0 || l->wheels->right_steps_s != 0;
}

static void wait(struct life *l, uint64_t ns)
{
    if (l->base == &l->bus.base)
        bus_pass(&l->bus, ns);
    else
        pass(&l->line, ns);
}

static void perform(struct life *l, enum vs_guard_action action)
{
    int result;

    if (action == VS_GUARD_EXCHANGE)
        result = vs_base_exchange(l->base, &l->guard.command, &l->guard.reading);
    else if (action == VS_GUARD_RECOVER)
        result = vs_base_recover(l->base);
    else
        result = l->base->ops->close(l->base);
    vs_guard_done(&l->guard, result, *l->now_ns);
}

/* Lives for a while, the guard's own deadlines included, or until it exits. */
static void live_on(struct life *l, uint64_t ns)
{
    uint64_t until_ns = *l->now_ns + ns;
    struct vs_guard_reply reply;

    while (*l->now_ns < until_ns) {
        enum vs_guard_action action = vs_guard_next(&l->guard, *l->now_ns);
        uint64_t deadline_ns = vs_guard_deadline_ns(&l->guard);

        (void)vs_guard_reply(&l->guard, &reply);
        if (action == VS_GUARD_EXIT)
            return;
        if (action != VS_GUARD_WAIT)
            perform(l, action);
        else
            wait(l, (deadline_ns < until_ns ? deadline_ns : until_ns) - *l->now_ns);
        if (l->turning && !wheels_turn(l))
            l->rest_ns = *l->now_ns;
        l->turning = wheels_turn(l);
    }
}

static void ask(struct life *l, enum vs_guard_kind kind, int16_t speed)
{
    struct vs_guard_request request = {(uint32_t)kind, 1,
                                       {speed, (int16_t)-speed, 0, {0, {0}}, {{0}}},
                                       *l->now_ns + EXPIRY_NS};

    while (!vs_guard_listens(&l->guard))
        live_on(l, MS);
    vs_guard_request(&l->guard, &request, *l->now_ns);
}

static void begin_life(struct life *l, const struct vs_base_ops *ops, uint32_t seed)
{
    int i;

    memset(l, 0, sizeof *l);
    if (ops == &vs_base_argos) {
        begin(&l->line, seed);
        l->base = &l->line.base;
        l->wheels = &l->line.fw.body.outputs;
        l->now_ns = &l->line.now_ns;
    } else {
        bus_begin(&l->bus, ops, seed);
        l->base = &l->bus.base;
        l->wheels = &l->bus.body->outputs;
        l->now_ns = &l->bus.now_ns;
    }
    vs_guard_init(&l->guard, 0);
    live_on(l, 500 * MS);
    for (i = 0; i < 3; i++) {
        ask(l, VS_GUARD_ACT, 500);
        live_on(l, STEP_NS);
    }
    CHECK(wheels_turn(l));
}

/* Lets something go wrong, with the at-th byte or transaction from now. */
static void make(struct life *l, enum fault fault, uint32_t at)
{
    switch (fault) {
    case WRITE_LOST:
        l->line.lose_written = at;
        break;
    case READ_LOST:
        l->line.lose_read = at;
        break;
    case REFUSED:
        l->bus.wires.faults.refuse = at;
        break;
    case WRITE_FLIPPED:
        l->bus.wires.faults.flip_write = at;
        break;
    case READ_FLIPPED:
        l->bus.wires.faults.flip_read = at;
        break;
    case STUCK:
        l->bus.wires.stuck = 1;
        l->bus.stuck_until_ns = l->bus.now_ns + STUCK_NS;
        break;
    default:
        fw_york_reset(&l->bus.york, l->bus.now_ns / 1000);
        fw_gctronic_reset(&l->bus.gctronic, l->bus.now_ns / 1000);
        break;
    }
}

/* With HOLD the worker lives on and asks as loop.c does; it is told what fails. */
static void end_motion(struct life *l, enum cause cause)
{
    l->cause_ns = *l->now_ns;
    if (cause == STOPPED_WORKER)
        l->cause_ns = vs_guard_deadline_ns(&l->guard);
    else if (cause == HOLD)
        ask(l, VS_GUARD_ACT, 0);
    else if (cause == ORPHANED)
        vs_guard_orphaned(&l->guard, *l->now_ns);
    else
        ask(l, VS_GUARD_CLOSE, 0);
}

/* The fault is made before the motion ends, by so long while the worker senses, or then. */
static void test(const struct vs_base_ops *ops, enum cause cause, enum fault fault, uint32_t at,
                 uint32_t seed, uint64_t before_ns)
{
    struct life l;

    begin_life(&l, ops, seed);
    if (before_ns > 0) {
        ask(&l, VS_GUARD_SENSE, 0);
        make(&l, fault, at);
        live_on(&l, before_ns);
    }
    end_motion(&l, cause);
    if (before_ns == 0)
        make(&l, fault, at);
    live_on(&l, LIFE_NS);
    wait(&l, STEP_NS);
    CHECK(!wheels_turn(&l));
    if (cause == ORPHANED || cause == CLOSE)
        CHECK(l.guard.action == VS_GUARD_EXIT && l.guard.stopped);
    if (l.rest_ns <= l.cause_ns)
        return;
    CHECK(l.rest_ns < l.cause_ns + REST_NS);
    if (l.rest_ns - l.cause_ns > longest_ns)
        longest_ns = l.rest_ns - l.cause_ns;
}

static void test_line(enum cause cause, uint32_t seed)
{
    uint64_t before_ns = seed % 2 == 0 ? STEP_NS / 2 : 0;
    uint32_t at;

    for (at = 0; at <= 4 * EPUCK_ARGOS_ACTUATOR_LEN; at++)
        test(&vs_base_argos, cause, WRITE_LOST, at, seed, before_ns);
    for (at = 1; at <= 2 * EPUCK_ARGOS_SENSOR_LEN; at++)
        test(&vs_base_argos, cause, READ_LOST, at, seed, before_ns);
}

static void test_bus(const struct vs_base_ops *ops, enum cause cause, enum fault fault)
{
    uint32_t at;

    for (at = 1; at <= TRANSACTIONS; at++)
        test(ops, cause, fault, at, at, at % 2 == 0 ? (1 + at % 16) * MS : 0);
}

int main(void)
{
    int cause, fault;
    uint32_t seed;

    for (cause = HOLD; cause < CAUSES; cause++) {
        for (seed = 1; seed <= SEEDS; seed++)
            test_line((enum cause)cause, seed);
        for (fault = REFUSED; fault < FAULTS; fault++) {
            test_bus(&vs_base_gctronic, (enum cause)cause, (enum fault)fault);
            test_bus(&vs_base_york, (enum cause)cause, (enum fault)fault);
        }
    }
    printf("rest after at most %u ms\n", (unsigned int)(longest_ns / MS));
    return 0;
}
