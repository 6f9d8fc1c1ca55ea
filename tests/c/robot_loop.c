/* SPDX-License-Identifier: MIT */
/*
 * The worker's mind and the guard's together, millisecond by millisecond on virtual
 * time, against a host that loses, freezes and changes its mind at random, and a base
 * that answers late or not at all. argv[1]: how many random lives of 20 s.
 */
#include "robot_life.h"

#include "vs_bytes.h"

static void test_steps_follow_timesteps(void)
{
    struct world w;
    uint32_t before;

    begin(&w, 1);
    live_for(&w, 300 * MS);
    CHECK(w.steps == 0);
    open_session(&w);
    wish(&w, VS_RUN);
    good_host(&w, 1000 * MS);
    CHECK(turning(&w) && w.base.leds == VS_ROBOT_LED_RING);
    before = w.steps;
    good_host(&w, 1000 * MS);
    CHECK(w.steps == before + 10);
    CHECK(w.last_step_ns % TIMESTEP_NS == 20 * MS); /* the base was read before */
    before = w.steps;
    live_for(&w, 1000 * MS);
    CHECK(w.steps >= before + 8 && w.steps <= before + 10 && !turning(&w));
    CHECK(w.state.inits == 1);
}

/* The next timestep's STATE comes late_ms after its time, or before it. Returns how long after that
 * the controller is called for it [ms]; gap_ms: the longest time between two calls meanwhile. */
static int called_after(struct world *w, int late_ms, int *gap_ms)
{
    uint64_t due_ns = (w->now.base_ns + 60 * MS) / TIMESTEP_NS * TIMESTEP_NS + 50 * MS;
    uint64_t comes_ns = due_ns + (uint64_t)(late_ms + 50) * MS - 50 * MS;
    uint64_t before_ns = w->last_step_ns;
    int called_ms = -1;

    for (*gap_ms = 0; w->now.base_ns < due_ns + 49 * MS; before_ns = w->last_step_ns) {
        if (w->now.base_ns == comes_ns)
            receive(w, 1);
        live(w);
        if (w->last_step_ns == before_ns)
            continue;
        if ((int)((w->last_step_ns - before_ns) / MS) > *gap_ms)
            *gap_ms = (int)((w->last_step_ns - before_ns) / MS);
        if (called_ms < 0 && w->last_step_ns >= comes_ns)
            called_ms = (int)((w->last_step_ns - comes_ns) / MS);
    }
    return called_ms;
}

/* The controller is called as soon as its timestep comes, and never later than if the base were
 * read only then; the period stays within what it was. */
static void test_steps_are_locked_to_the_host(void)
{
    static const int lates_ms[] = {0, 4, 9, 2, 0, 12, 0};
    const int exchange_ms = EXCHANGE_NS / MS, period_ms = TIMESTEP_NS / MS;
    struct world w;
    int sum_ms = 0;
    int gap_ms;
    size_t i;

    begin(&w, 11);
    open_session(&w);
    wish(&w, VS_RUN);
    for (i = 0; i < 10; i++)
        called_after(&w, 0, &gap_ms);
    for (i = 0; i < sizeof lates_ms / sizeof lates_ms[0]; i++) {
        CHECK(called_after(&w, lates_ms[i], &gap_ms) <= 2);
        CHECK(gap_ms >= period_ms / 2 && gap_ms <= period_ms * 5 / 4);
    }
    CHECK(called_after(&w, -20, &gap_ms) == exchange_ms); /* nobody could know */
    for (i = 0; i < 10; i++)
        called_after(&w, 0, &gap_ms);
    CHECK(called_after(&w, 45, &gap_ms) == -1 && gap_ms <= period_ms * 5 / 4);
    for (i = 0; i < 10; i++) /* one that is lost moves nobody */
        CHECK(called_after(&w, i == 5 ? 1000 : 0, &gap_ms) <= 0 || i == 0);
    for (i = 0; i < 300; i++) {
        sum_ms += called_after(&w, (int)draw(&w.random, 11), &gap_ms);
        CHECK(gap_ms >= period_ms / 2 && gap_ms <= period_ms * 5 / 4);
    }
    CHECK(sum_ms <= 300); /* 1 ms on average, where the exchange takes 8 */
}

static void test_three_fresh_frames_begin_motion(void)
{
    struct world w;
    int frame;

    begin(&w, 2);
    open_session(&w);
    wish(&w, VS_RUN);
    for (frame = 1; frame <= 4; frame++) {
        receive(&w, 1);
        live_for(&w, 20 * MS);
        CHECK(turning(&w) == (frame >= 4) || frame == 3);
        live_for(&w, 30 * MS);
        receive(&w, 0);
        live_for(&w, 50 * MS);
        CHECK(turning(&w) == (frame >= 3));
        CHECK(vs_loop_cause(&w.loop, &w.now) == (frame >= 3 ? VS_CAUSE_NONE : VS_CAUSE_STALE));
    }
    live_for(&w, 500 * MS);
    CHECK(!turning(&w));
    receive(&w, 1);
    live_for(&w, 100 * MS);
    CHECK(!turning(&w));
}

/* As many STATE packets as set a robot going, of captures that are so old when they come. */
static void hear_captures(struct world *w, uint64_t age_ns)
{
    int i;

    for (i = 0; i < 10; i++) {
        w->session.newest_capture_ns = w->now.session_ns - 72000 * MS - age_ns;
        w->session.capture_ns = w->session.newest_capture_ns;
        w->session.fresh_ns = w->now.session_ns;
        w->session.timestep++;
        if (age_ns <= VS_SAFETY_SILENCE_NS)
            w->fresh_ns = w->now.base_ns;
        vs_loop_event(&w->loop, VS_EV_STATE, &w->now);
        live_for(w, 100 * MS);
    }
}

static void test_old_frames_are_not_fresh(void)
{
    struct world w;

    begin(&w, 3);
    open_session(&w);
    wish(&w, VS_RUN);
    /* host's clock minus ours is -72 s, known to 5 ms: what it is at best counts for nothing */
    CHECK(vs_clock_sample(&w.session.clock, w.now.session_ns - 10 * MS,
                          w.now.session_ns - 72000 * MS - 5 * MS, 0, w.now.session_ns) == VS_OK);
    hear_captures(&w, 500 * MS);
    CHECK(!turning(&w));
    hear_captures(&w, 402 * MS);
    CHECK(!turning(&w));
    hear_captures(&w, 398 * MS);
    CHECK(turning(&w));
    hear_captures(&w, 402 * MS);
    CHECK(!turning(&w));
    good_host(&w, 500 * MS);
    CHECK(turning(&w));
}

static void test_controller_lives_as_long_as_its_run(void)
{
    struct world w;

    begin(&w, 4);
    open_session(&w);
    wish(&w, VS_RUN);
    good_host(&w, 1000 * MS);
    wish(&w, VS_PAUSE);
    good_host(&w, 300 * MS);
    CHECK(!turning(&w) && w.base.leds == VS_ROBOT_LED_RING);
    wish(&w, VS_RUN);
    good_host(&w, 300 * MS);
    CHECK(turning(&w) && w.state.inits == 1 && w.state.steps > 10 && ended == 0);
    w.session.run++;
    good_host(&w, 100 * MS);
    CHECK(w.state.inits == 1 && w.state.steps <= 2 && ended == 1);
    vs_loop_event(&w.loop, VS_EV_GOODBYE, &w.now);
    vs_loop_event(&w.loop, VS_EV_GOODBYE, &w.now);
    CHECK(ended == 2);
    wish(&w, VS_STOP);
    good_host(&w, 100 * MS);
    CHECK(!turning(&w) && w.base.leds == 0);
}

static void test_end_and_lost_guard(void)
{
    struct world w;

    begin(&w, 5);
    open_session(&w);
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
    vs_loop_end(&w.loop);
    CHECK(ended == 1);
    wish(&w, VS_STOP);
    good_host(&w, 100 * MS);
    CHECK(!turning(&w) && w.action == VS_GUARD_EXIT && w.guard.stopped);
    CHECK(vs_loop_cause(&w.loop, &w.now) == VS_CAUSE_SIGNAL);
}

/* The controller is not called, its wheels and LEDs do not count; what keeps its wheels turning
 * keeps these. */
static void test_home_is_no_run(void)
{
    struct world w;
    uint32_t steps;

    begin(&w, 5);
    open_session(&w);
    wish(&w, VS_RUN);
    good_host(&w, 1000 * MS);
    CHECK(w.base.leds == VS_ROBOT_LED_RING && w.base.right_steps_s == -300);
    steps = w.steps;
    wish(&w, VS_HOME);
    good_host(&w, 1000 * MS);
    CHECK(w.steps == steps && w.base.leds == 0);
    CHECK(w.base.left_steps_s == 930 && w.base.right_steps_s == 930);
    CHECK(vs_loop_cause(&w.loop, &w.now) == VS_CAUSE_NONE);
    live_for(&w, 500 * MS);
    CHECK(!turning(&w) && vs_loop_cause(&w.loop, &w.now) == VS_CAUSE_STALE);
    good_host(&w, 1000 * MS);
    CHECK(turning(&w));
    wish(&w, VS_STOP);
    good_host(&w, 100 * MS);
    CHECK(!turning(&w) && w.steps == steps);
    wish(&w, VS_RUN);
    good_host(&w, 1000 * MS);
    CHECK(w.steps > steps && w.base.right_steps_s == -300);
}

/* The host's parameter holds for the controller and on the way home; both wheels keep their ratio. */
static void test_speed_limit(void)
{
    static const char *const params[] = {"vs:v_max=0.05\n", "vs:v_max=fast\n", "vs:v_max=-1\n"};
    struct world w;
    size_t i;

    for (i = 0; i < 3; i++) {
        begin(&w, 5);
        strcpy(w.session.params, params[i]);
        open_session(&w);
        wish(&w, VS_HOME);
        good_host(&w, 1000 * MS);
        CHECK(w.base.left_steps_s == (i == 0 ? 384 : 0) && w.base.right_steps_s == w.base.left_steps_s);
        wish(&w, VS_RUN);
        good_host(&w, 1000 * MS);
        CHECK(w.base.left_steps_s == (i == 0 ? 384 : 0)); /* 10 kHz / 26: 0.0495 m/s */
        CHECK(w.base.right_steps_s == (i == 0 ? -57 : 0)); /* of 2000 and -300 */
        CHECK(vs_robot_unasked_param(&w.loop.robot, NULL) == NULL);
    }
}

/* With a limit no wheel is faster than without, or turns the other way, nor are e-puck's motors
 * faster than it: their speed is 10 kHz by a whole number (epuck.md 6). */
static void test_slow_takes_motion_away_only(void)
{
    uint32_t random = 7;
    int i;

    for (i = 0; i < 100000; i++) {
        struct vs_base_command before, after;
        struct vs_base_reading base;
        uint32_t v_max_nm_s = draw(&random, 8) ? draw(&random, 200000000) : UINT32_MAX;
        int16_t most;

        memset(&base, 0, sizeof base);
        memset(&before, 0, sizeof before);
        base.step_nm = draw(&random, 2) ? 125664 : 0;
        base.max_steps_s = draw(&random, 2) ? 1100 : 0;
        most = vs_safety_max_steps_s(&base, v_max_nm_s);
        CHECK(most >= 0 && most <= (base.max_steps_s > 0 ? 1100 : 1000));
        CHECK(most >= 1000 ||
              (most + 2) * 1.11 * (base.step_nm > 0 ? 125664 : 128805) > v_max_nm_s);
        before.left_steps_s = (int16_t)((int32_t)draw(&random, 65535) - 32767);
        before.right_steps_s = (int16_t)((int32_t)draw(&random, 65535) - 32767);
        after = before;
        vs_safety_slow(&after, v_max_nm_s, most);
        if (v_max_nm_s == UINT32_MAX) {
            CHECK(memcmp(&after, &before, sizeof after) == 0);
            continue;
        }
        CHECK(abs(after.left_steps_s) <= most && abs(after.right_steps_s) <= most);
        CHECK(abs(after.left_steps_s) <= abs(before.left_steps_s));
        CHECK(abs(after.right_steps_s) <= abs(before.right_steps_s));
        CHECK((int32_t)after.left_steps_s * before.left_steps_s >= 0);
        CHECK((int32_t)after.right_steps_s * before.right_steps_s >= 0);
        if (abs(before.left_steps_s) <= most && abs(before.right_steps_s) <= most)
            CHECK(after.left_steps_s == before.left_steps_s);
        if (after.left_steps_s != 0 && most < 1000)
            CHECK(10000.0 / (10000 / abs(after.left_steps_s)) * (base.step_nm > 0 ? 125664 : 128805) <=
                  v_max_nm_s);
    }
}

/* The session's clock, of any offset, passes 2^64 in mid-life. */
static void test_random_life(uint32_t seed, uint64_t timestep_ns, uint32_t fault_one_in)
{
    static const uint8_t wishes[] = {VS_RUN, VS_RUN, VS_HOME, VS_PAUSE, VS_STOP, VS_IDLE};
    struct world w;
    uint32_t loss;
    uint32_t frozen = 0;
    uint64_t end_ns;

    begin(&w, seed);
    w.timestep_ns = timestep_ns;
    w.fault_one_in = fault_one_in;
    w.now.session_ns = UINT64_MAX - draw(&w.random, 20000) * MS;
    loss = draw(&w.random, 60);
    end_ns = w.now.base_ns + 20000 * MS;
    w.wished_ns = 1;
    while (w.now.base_ns < end_ns) {
        if (draw(&w.random, 2000) == 0) {
            w.session.open = !w.session.open;
            if (w.session.open)
                w.telemetry_ns = w.now.base_ns;
            vs_loop_event(&w.loop, w.session.open ? VS_EV_OPEN : VS_EV_NONE, &w.now);
            w.session.timestep_ns = timestep_ns;
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

/* A step counts once its command is with the base. */
static void test_completed_steps(void)
{
    struct vs_telemetry telemetry;
    struct world w;

    begin(&w, 6);
    open_session(&w);
    wish(&w, VS_RUN);
    good_host(&w, 1000 * MS);
    while (!w.loop.acting)
        good_host(&w, MS);
    w.loop.telemetry_due = VS_TELL_NEWS;
    CHECK(vs_loop_telemetry(&w.loop, &w.now, &telemetry));
    CHECK(telemetry.control_step == w.loop.step.number - 1);
    good_host(&w, 20 * MS);
    w.loop.telemetry_due = VS_TELL_NEWS;
    CHECK(vs_loop_telemetry(&w.loop, &w.now, &telemetry));
    CHECK(telemetry.control_step == w.loop.step.number);
}

/* Lives for a while; returns how the host was told at the end of it. */
static enum vs_telling told_after(struct world *w, uint64_t ns)
{
    struct vs_telemetry telemetry;

    w->now.base_ns += ns;
    w->now.session_ns += ns;
    return vs_loop_telemetry(&w->loop, &w->now, &telemetry);
}

/* What is told leaves twice, and no third time; what has changed never waits for a copy. */
static void test_telemetry_leaves_twice(void)
{
    struct world w;

    begin(&w, 9);
    open_session(&w);
    CHECK(told_after(&w, 0) == VS_TELL_NEWS && told_after(&w, 0) == VS_TELL_NOTHING);
    CHECK(told_after(&w, 80 * MS) == VS_TELL_AGAIN && told_after(&w, 0) == VS_TELL_NOTHING);
    CHECK(told_after(&w, 80 * MS) == VS_TELL_NEWS && told_after(&w, 80 * MS) == VS_TELL_AGAIN);
    CHECK(told_after(&w, 80 * MS) == VS_TELL_NEWS);
    w.session.wanted = VS_PAUSE; /* of this it has to hear at once, though the wheels stand still */
    CHECK(told_after(&w, 80 * MS) == VS_TELL_NEWS);
    w.session.run++;
    CHECK(told_after(&w, 80 * MS) == VS_TELL_NEWS);
    vs_log_add(&w.loop.robot.log, "one");
    CHECK(told_after(&w, 80 * MS) == VS_TELL_NEWS && told_after(&w, 80 * MS) == VS_TELL_AGAIN);
    CHECK(told_after(&w, 80 * MS) == VS_TELL_NEWS);
    vs_log_heard(&w.loop.robot.log, 1);
    CHECK(told_after(&w, 80 * MS) == VS_TELL_NEWS && told_after(&w, 80 * MS) == VS_TELL_AGAIN);
    CHECK(told_after(&w, 80 * MS) == VS_TELL_NEWS);
    w.session.peer.session = 1;
    w.session.peer.remote_no_udp = 1; /* TCP loses nothing */
    CHECK(told_after(&w, 80 * MS) == VS_TELL_NEWS);
    w.session.peer.session = 0;
    CHECK(told_after(&w, 80 * MS) == VS_TELL_AGAIN);
}

/* A reading of the robot's own goes up with how long ago it was set, until another run begins. */
static void test_readings_go_up_with_their_age(void)
{
    struct vs_telemetry telemetry;
    struct world w;
    int own;

    begin(&w, 10);
    CHECK(vs_table_add(&w.session.table, 2, VS_ACTUATOR, "pump", "u1") == VS_OK);
    CHECK(vs_table_add(&w.session.table, 3, VS_READING, "own", "2*u1") == VS_OK);
    open_session(&w);
    CHECK(vs_loop_telemetry(&w.loop, &w.now, &telemetry) == VS_TELL_NEWS);
    CHECK(memcmp(telemetry.payload, "\0\xff\xff\xff\xff\0\0", 7) == 0);
    own = vs_robot_actuator(&w.loop.robot, "own");
    w.loop.robot.session_ns = w.now.session_ns;
    vs_robot_actuate(&w.loop.robot, own, 1, 7.0);
    w.now.session_ns += 30 * MS + 999;
    w.loop.telemetry_due = VS_TELL_NEWS;
    CHECK(vs_loop_telemetry(&w.loop, &w.now, &telemetry) == VS_TELL_NEWS);
    CHECK(memcmp(telemetry.payload, "\0\x30\x75\0\0\0\x07", 7) == 0);
    w.now.session_ns += 4294967 * UINT64_C(1000000000); /* longer ago than can be said */
    w.loop.telemetry_due = VS_TELL_NEWS;
    CHECK(vs_loop_telemetry(&w.loop, &w.now, &telemetry) == VS_TELL_NEWS);
    CHECK(vs_load_u32(telemetry.payload + 1) == VS_NEVER_US);
    vs_robot_actuate(&w.loop.robot, own, 1, 8.0);
    vs_robot_forget(&w.loop.robot);
    w.loop.telemetry_due = VS_TELL_NEWS;
    CHECK(vs_loop_telemetry(&w.loop, &w.now, &telemetry) == VS_TELL_NEWS);
    CHECK(memcmp(telemetry.payload, "\0\xff\xff\xff\xff\0\0", 7) == 0);
}

/* What a controller did with its actuators ends with its experiment, not with a session. */
static void test_actuators_end_with_their_experiment(void)
{
    struct world w;

    begin(&w, 8);
    open_session(&w);
    wish(&w, VS_RUN);
    good_host(&w, 500 * MS);
    w.loop.robot.actuators[0] = 5;
    w.session.received_ns = 0;
    w.session.run = 0;
    open_session(&w);
    CHECK(w.loop.robot.actuators[0] == 5 && w.state.inits == 1);
    w.session.run = 1;
    receive(&w, 1);
    CHECK(w.loop.robot.actuators[0] == 0);
    w.loop.robot.actuators[0] = 5;
    w.session.offer++;
    open_session(&w);
    CHECK(w.loop.robot.actuators[0] == 0);
}

/* A robot that runs, whose worker has just asked the guard for a sign of life. */
static void ping(struct world *w)
{
    struct vs_guard_request request;

    begin(w, 1);
    open_session(w);
    wish(w, VS_RUN);
    good_host(w, 1040 * MS); /* to 20 ms after a step */
    while (w->loop.waiting || w->loop.timestep_new)
        live(w);
    w->now.base_ns = w->loop.sent_ns + VS_LOOP_PING_NS;
    CHECK(vs_loop_request(&w->loop, &w->now, &request) && request.kind == VS_GUARD_PING);
}

/* The answer to a PING need not wake the worker, unless a control step waits for it. */
static void test_ping_delays_no_step(void)
{
    struct world w;
    uint64_t late_ns;

    ping(&w);
    CHECK(vs_loop_is_patient(&w.loop, &w.now));
    late_ns = w.loop.begin_ns + w.timestep_ns + w.timestep_ns / 4; /* no STATE comes */
    CHECK(vs_loop_wake_ns(&w.loop, &w.now) <= late_ns);
    w.now.base_ns = w.loop.begin_ns + w.timestep_ns - 2 * MS;
    CHECK(vs_loop_is_patient(&w.loop, &w.now));
    receive(&w, 1);
    CHECK(!vs_loop_is_patient(&w.loop, &w.now));
    ping(&w);
    w.now.base_ns = late_ns;
    CHECK(!vs_loop_is_patient(&w.loop, &w.now));
}

/* Nor need that to SENSE, before the timestep comes for which the base is read. */
static void test_a_base_that_is_read_early_wakes_nobody(void)
{
    struct vs_guard_request request;
    struct world w;

    begin(&w, 12);
    open_session(&w);
    wish(&w, VS_RUN);
    good_host(&w, 1040 * MS);
    w.now.base_ns += 71 * MS; /* nine before the next */
    CHECK(vs_loop_request(&w.loop, &w.now, &request) && request.kind == VS_GUARD_SENSE);
    CHECK(vs_loop_is_patient(&w.loop, &w.now) && !vs_loop_is_answered(&w.loop, &w.now));
    CHECK(vs_loop_wake_ns(&w.loop, &w.now) <= w.loop.hold_ns);
    w.now.base_ns += 9 * MS;
    CHECK(vs_loop_is_answered(&w.loop, &w.now));
    receive(&w, 1);
    CHECK(!vs_loop_is_patient(&w.loop, &w.now));
}

/* The controller wants 2000 steps/s: it gets what its robot's motors can do. */
static void test_speed_limit_is_the_base_s(void)
{
    static const int16_t limits[2][2] = {{0, 1000}, {1100, 1100}};
    struct world w;
    int i;

    for (i = 0; i < 2; i++) {
        begin(&w, 9);
        w.max_steps_s = limits[i][0];
        open_session(&w);
        wish(&w, VS_RUN);
        good_host(&w, 1000 * MS);
        CHECK(w.base.left_steps_s == limits[i][1] && w.base.right_steps_s == -300);
    }
}

/* A step counts as late where the last one began more than one and a half timesteps before. */
static void test_late_steps_are_counted(void)
{
    static const int gaps_ms[] = {110, 149, 151, 250};
    struct vs_guard_request request;
    struct world w;
    size_t i;

    for (i = 0; i < sizeof gaps_ms / sizeof gaps_ms[0]; i++) {
        begin(&w, 13);
        open_session(&w);
        wish(&w, VS_RUN);
        good_host(&w, 1040 * MS);
        while (w.loop.waiting || w.loop.timestep_new)
            live(&w);
        CHECK(w.loop.overruns == 0);
        w.now.base_ns = w.loop.step_ns + (uint64_t)gaps_ms[i] * MS;
        CHECK(vs_loop_request(&w.loop, &w.now, &request) && request.kind == VS_GUARD_SENSE);
        CHECK(w.loop.overruns == (gaps_ms[i] > 150));
    }
}

/* Who measures a robot would apply what was measured twice. */
static void test_raw_readings_are_those_of_the_base_until_the_run_ends(void)
{
    struct vs_calibration measured;
    struct world w;

    memset(&measured, 0, sizeof measured);
    CHECK(vs_calibration_take(&measured, "proximity-scale", "-100:900") == NULL);
    begin(&w, 4);
    w.loop.calibration = &measured;
    open_session(&w);
    wish(&w, VS_RUN);
    good_host(&w, 500 * MS);
    CHECK(w.loop.robot.base.prox[0] == 207); /* 67 + 1399 / 10 for the base's 0 */
    vs_robot_sense_raw(&w.loop.robot);
    good_host(&w, 200 * MS);
    CHECK(w.loop.robot.base.prox[0] == 0);
    wish(&w, VS_STOP);
    good_host(&w, 200 * MS);
    w.session.run++;
    wish(&w, VS_RUN);
    good_host(&w, 500 * MS);
    CHECK(w.loop.robot.base.prox[0] == 207);
}

int main(int argc, char *argv[])
{
    uint32_t lives = argc > 1 ? (uint32_t)strtoul(argv[1], NULL, 10) : 50;
    uint32_t seed;

    test_steps_follow_timesteps();
    test_steps_are_locked_to_the_host();
    test_three_fresh_frames_begin_motion();
    test_old_frames_are_not_fresh();
    test_controller_lives_as_long_as_its_run();
    test_end_and_lost_guard();
    test_home_is_no_run();
    test_speed_limit();
    test_slow_takes_motion_away_only();
    test_completed_steps();
    test_telemetry_leaves_twice();
    test_readings_go_up_with_their_age();
    test_actuators_end_with_their_experiment();
    test_ping_delays_no_step();
    test_a_base_that_is_read_early_wakes_nobody();
    test_speed_limit_is_the_base_s();
    test_late_steps_are_counted();
    test_raw_readings_are_those_of_the_base_until_the_run_ends();
    for (seed = 1; seed <= lives; seed++) {
        test_random_life(seed, TIMESTEP_NS, seed % 2 ? 0 : 40);
        test_random_life(seed, 10 * MS, seed % 2 ? 0 : 40);
        test_random_life(seed, 200 * MS, seed % 2 ? 0 : 10);
    }
    return 0;
}
