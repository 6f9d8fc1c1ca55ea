/* SPDX-License-Identifier: MIT */
/*
 * The worker's mind and the guard's together, millisecond by millisecond on virtual
 * time, against a host that loses, freezes and changes its mind at random.
 * argv[1]: how many random lives of 20 s.
 */
#include <string.h>

#include "check.h"
#include "loop.h"
#include "robot_check.h"

#define MS UINT64_C(1000000)
#define TIMESTEP_NS (100 * MS)
#define EXCHANGE_NS (8 * MS)

struct seen {
    int inits;
    int steps;
    int polluted;
};

static uint64_t stepped_ns; /* newest call of the controller; tests only */

static void init(void *state, struct vs_robot *robot)
{
    struct seen *seen = state;

    CHECK(seen->steps == 0);
    seen->inits++;
    seen->polluted = vs_robot_sensor(robot, "pollutant");
}

static void step(void *state, struct vs_robot *robot)
{
    struct seen *seen = state;

    seen->steps++;
    stepped_ns = robot->now_ns;
    vs_robot_set_wheels(robot, 2000, -300);
    vs_robot_set_leds(robot, VS_ROBOT_LED_RING);
}

static const struct vs_controller runner = {"runner", sizeof(struct seen), init, step};

struct world {
    struct vs_session session;
    struct vs_loop loop;
    struct vs_guard guard;
    struct seen state;
    struct vs_instant now;
    struct vs_base_command base; /* what the wheels do */
    uint64_t answer_ns;          /* the base's exchange is over then, 0 = none */
    enum vs_guard_action action;
    uint32_t random;
    uint64_t fresh_ns;           /* newest frame whose capture advanced */
    uint64_t wished_ns;          /* when the host last forbade motion, 0 = it wants it */
    uint64_t telemetry_ns;
    uint64_t last_step_ns;
    uint32_t steps;
};

static void begin(struct world *w, uint32_t seed)
{
    struct vs_session_config config;

    memset(w, 0, sizeof *w);
    memset(&config, 0, sizeof config);
    config.tag = 23;
    w->random = seed * 2654435761u + 1u;
    w->now.base_ns = 5000 * MS;
    w->now.session_ns = 77000 * MS;
    CHECK(vs_session_init(&w->session, &config) == VS_OK);
    CHECK(vs_table_add(&w->session.table, 1, VS_SENSOR, "pollutant", "f4") == VS_OK);
    vs_loop_init(&w->loop, &w->session, &runner, &w->state);
    vs_guard_init(&w->guard, 1);
    stepped_ns = 0;
}

static void open(struct world *w)
{
    w->session.open = 1;
    w->session.timestep_ns = TIMESTEP_NS;
    vs_loop_event(&w->loop, VS_EV_OPEN, &w->now);
}

/* A STATE arrives, as vs_session would show it. */
static void receive(struct world *w, int advances)
{
    struct vs_session *s = &w->session;

    s->received_ns = w->now.session_ns;
    s->timestep = (uint32_t)(w->now.base_ns / TIMESTEP_NS);
    if (advances) {
        s->capture_ns = s->newest_capture_ns = w->now.base_ns - 20 * MS;
        s->fresh_ns = w->now.session_ns;
        w->fresh_ns = w->now.base_ns;
    }
    vs_loop_event(&w->loop, VS_EV_STATE, &w->now);
}

static void wish(struct world *w, uint8_t wanted)
{
    w->session.wanted = wanted;
    if (wanted == VS_RUN)
        w->wished_ns = 0;
    else if (w->wished_ns == 0)
        w->wished_ns = w->now.base_ns;
}

static void serve_guard(struct world *w)
{
    struct vs_guard_request request;
    struct vs_guard_reply reply;
    struct vs_base_reading reading;

    memset(&reading, 0, sizeof reading);
    if (w->answer_ns != 0 && w->now.base_ns >= w->answer_ns) {
        w->guard.reading = reading;
        w->base = w->guard.command;
        w->answer_ns = 0;
        vs_guard_done(&w->guard, VS_OK, w->now.base_ns);
    }
    if (vs_guard_reply(&w->guard, &reply))
        vs_loop_reply(&w->loop, &reply, &w->now);
    if (vs_loop_request(&w->loop, &w->now, &request)) {
        CHECK(w->answer_ns == 0 || vs_guard_listens(&w->guard));
        vs_guard_request(&w->guard, &request, w->now.base_ns);
    }
    if (w->answer_ns != 0)
        return;
    w->action = vs_guard_next(&w->guard, w->now.base_ns);
    if (w->action != VS_GUARD_WAIT && w->action != VS_GUARD_EXIT)
        w->answer_ns = w->now.base_ns + EXCHANGE_NS;
}

static int turning(const struct world *w)
{
    return w->base.left_steps_s != 0 || w->base.right_steps_s != 0;
}

static void check_always(struct world *w)
{
    struct vs_telemetry telemetry;
    uint64_t now_ns = w->now.base_ns;

    if (turning(w)) {
        CHECK(w->base.left_steps_s == 1000 && w->base.right_steps_s == -300);
        CHECK(now_ns < w->fresh_ns + VS_SAFETY_SILENCE_NS + 3 * EXCHANGE_NS);
        CHECK(w->wished_ns == 0 || now_ns < w->wished_ns + 50 * MS);
    }
    if (stepped_ns != w->last_step_ns) {
        CHECK(w->steps == 0 || stepped_ns - w->last_step_ns >= TIMESTEP_NS / 2 - EXCHANGE_NS);
        w->last_step_ns = stepped_ns;
        w->steps++;
        CHECK(w->loop.step.number == w->steps);
    }
    if (vs_loop_telemetry(&w->loop, &w->now, &telemetry)) {
        w->telemetry_ns = now_ns;
        CHECK(telemetry.stop_cause != VS_CAUSE_NONE || telemetry.state == VS_RUN);
        CHECK(telemetry.state != VS_RUN || w->session.wanted == VS_RUN);
    }
    CHECK(!w->session.open || now_ns - w->telemetry_ns <= VS_LOOP_TELEMETRY_NS + MS);
}

static void live(struct world *w)
{
    serve_guard(w);
    check_always(w);
    w->now.base_ns += MS;
    w->now.session_ns += MS;
}

static void live_for(struct world *w, uint64_t ns)
{
    uint64_t until_ns = w->now.base_ns + ns;

    while (w->now.base_ns < until_ns)
        live(w);
}

/* A host as it should be, for ns. */
static void good_host(struct world *w, uint64_t ns)
{
    uint64_t until_ns = w->now.base_ns + ns;

    while (w->now.base_ns < until_ns) {
        if (w->now.base_ns % (50 * MS) == 20 * MS)
            receive(w, w->now.base_ns % (100 * MS) == 20 * MS);
        live(w);
    }
}

static void test_steps_follow_timesteps(void)
{
    struct world w;
    uint32_t before;

    begin(&w, 1);
    live_for(&w, 300 * MS);
    CHECK(w.steps == 0);
    open(&w);
    wish(&w, VS_RUN);
    good_host(&w, 1000 * MS);
    CHECK(turning(&w) && w.base.leds == VS_ROBOT_LED_RING);
    before = w.steps;
    good_host(&w, 1000 * MS);
    CHECK(w.steps == before + 10);
    CHECK((w.last_step_ns - EXCHANGE_NS) % TIMESTEP_NS == 20 * MS);
    before = w.steps;
    live_for(&w, 1000 * MS);
    CHECK(w.steps == before + 8 && !turning(&w));
    CHECK(w.state.inits == 1);
}

static void test_three_fresh_frames_begin_motion(void)
{
    struct world w;
    int frame;

    begin(&w, 2);
    open(&w);
    wish(&w, VS_RUN);
    for (frame = 1; frame <= 4; frame++) {
        receive(&w, 1);
        live_for(&w, 20 * MS);
        CHECK(turning(&w) == (frame >= 4) || frame == 3);
        live_for(&w, 80 * MS);
        CHECK(turning(&w) == (frame >= 3));
        CHECK(vs_loop_cause(&w.loop, &w.now) == (frame >= 3 ? VS_CAUSE_NONE : VS_CAUSE_STALE));
        receive(&w, 0);
        live_for(&w, 2 * MS);
    }
    live_for(&w, 500 * MS);
    CHECK(!turning(&w));
    receive(&w, 1);
    live_for(&w, 100 * MS);
    CHECK(!turning(&w));
}

static void test_old_frames_are_not_fresh(void)
{
    struct world w;
    int i;

    begin(&w, 3);
    open(&w);
    wish(&w, VS_RUN);
    /* host's clock minus ours is -72 s, known to 5 ms */
    CHECK(vs_clock_sample(&w.session.clock, w.now.session_ns - 10 * MS,
                          w.now.session_ns - 72000 * MS - 5 * MS, 0, w.now.session_ns) == VS_OK);
    for (i = 0; i < 10; i++) {
        w.session.newest_capture_ns = w.now.session_ns - 72000 * MS - 500 * MS;
        w.session.capture_ns = w.session.newest_capture_ns;
        w.session.fresh_ns = w.now.session_ns;
        w.session.timestep++;
        vs_loop_event(&w.loop, VS_EV_STATE, &w.now);
        live_for(&w, 100 * MS);
        CHECK(!turning(&w));
    }
    good_host(&w, 500 * MS);
    CHECK(turning(&w));
}

static void test_controller_lives_as_long_as_its_run(void)
{
    struct world w;

    begin(&w, 4);
    open(&w);
    wish(&w, VS_RUN);
    good_host(&w, 1000 * MS);
    wish(&w, VS_PAUSE);
    good_host(&w, 300 * MS);
    CHECK(!turning(&w) && w.base.leds == VS_ROBOT_LED_RING);
    wish(&w, VS_RUN);
    good_host(&w, 300 * MS);
    CHECK(turning(&w) && w.state.inits == 1 && w.state.steps > 10);
    w.session.run++;
    good_host(&w, 100 * MS);
    CHECK(w.state.inits == 1 && w.state.steps <= 2);
    wish(&w, VS_STOP);
    good_host(&w, 100 * MS);
    CHECK(!turning(&w) && w.base.leds == 0);
}

static void test_end_and_lost_guard(void)
{
    struct world w;

    begin(&w, 5);
    open(&w);
    wish(&w, VS_RUN);
    good_host(&w, 1000 * MS);
    vs_guard_init(&w.guard, 1);
    w.answer_ns = 0;
    memset(&w.base, 0, sizeof w.base);
    vs_loop_guard_lost(&w.loop);
    CHECK(vs_loop_cause(&w.loop, &w.now) == VS_CAUSE_GUARD);
    good_host(&w, 300 * MS);
    CHECK(turning(&w));
    vs_loop_end(&w.loop);
    wish(&w, VS_STOP);
    good_host(&w, 100 * MS);
    CHECK(!turning(&w) && w.action == VS_GUARD_EXIT && w.guard.stopped);
    CHECK(vs_loop_cause(&w.loop, &w.now) == VS_CAUSE_SIGNAL);
}

static void test_random_life(uint32_t seed)
{
    static const uint8_t wishes[] = {VS_RUN, VS_RUN, VS_RUN, VS_PAUSE, VS_STOP, VS_IDLE};
    struct world w;
    uint32_t loss;
    uint32_t frozen = 0;
    uint64_t end_ns;

    begin(&w, seed);
    loss = draw(&w.random, 60);
    end_ns = w.now.base_ns + 20000 * MS;
    w.wished_ns = 1;
    while (w.now.base_ns < end_ns) {
        if (draw(&w.random, 2000) == 0) {
            w.session.open = !w.session.open;
            if (w.session.open)
                w.telemetry_ns = w.now.base_ns;
            vs_loop_event(&w.loop, w.session.open ? VS_EV_OPEN : VS_EV_NONE, &w.now);
            w.session.timestep_ns = TIMESTEP_NS;
        }
        if (draw(&w.random, 1000) == 0)
            frozen = draw(&w.random, 2);
        if (w.session.open && draw(&w.random, 50) == 0 && draw(&w.random, 100) >= loss) {
            wish(&w, draw(&w.random, 30) ? w.session.wanted : wishes[draw(&w.random, 6)]);
            receive(&w, !frozen);
        }
        live(&w);
    }
}

int main(int argc, char *argv[])
{
    uint32_t lives = argc > 1 ? (uint32_t)strtoul(argv[1], NULL, 10) : 50;
    uint32_t seed;

    test_steps_follow_timesteps();
    test_three_fresh_frames_begin_motion();
    test_old_frames_are_not_fresh();
    test_controller_lives_as_long_as_its_run();
    test_end_and_lost_guard();
    for (seed = 1; seed <= lives; seed++)
        test_random_life(seed);
    return 0;
}
