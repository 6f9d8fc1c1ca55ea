/* SPDX-License-Identifier: MIT */
#include "robot_life.h"

int ended;
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

static void end(void *state, struct vs_robot *robot)
{
    struct seen *seen = state;

    (void)robot;
    CHECK(seen->inits == 1); /* it sees what init began */
    ended++;
}

static const struct vs_controller runner = {"runner", sizeof(struct seen), init, step, end};

void begin(struct world *w, uint32_t seed)
{
    struct vs_session_config config;

    memset(w, 0, sizeof *w);
    memset(&config, 0, sizeof config);
    config.tag = 23;
    w->random = seed * 2654435761u + 1u;
    w->now.base_ns = 5000 * MS;
    w->now.session_ns = 77000 * MS;
    w->timestep_ns = TIMESTEP_NS;
    CHECK(vs_session_init(&w->session, &config) == VS_OK);
    CHECK(vs_table_add(&w->session.table, 1, VS_SENSOR, "pollutant", "f4") == VS_OK);
    w->session.peer.tx_sequence = 2; /* the first packets go by TCP, too */
    vs_loop_init(&w->loop, &w->session, &runner, &w->state);
    vs_guard_init(&w->guard, 1);
    stepped_ns = 0;
    ended = 0;
}

void open_session(struct world *w)
{
    w->session.open = 1;
    w->session.timestep_ns = w->timestep_ns;
    vs_loop_event(&w->loop, VS_EV_OPEN, &w->now);
}

/* A STATE arrives, as vs_session would show it. */
void receive(struct world *w, int advances)
{
    struct vs_session *s = &w->session;

    s->received_ns = w->now.session_ns;
    s->timestep = (uint32_t)(w->now.base_ns / w->timestep_ns);
    if (advances) {
        s->capture_ns = s->newest_capture_ns = w->now.base_ns - 20 * MS;
        s->fresh_ns = w->now.session_ns;
        w->fresh_ns = w->now.base_ns;
    }
    vs_loop_event(&w->loop, VS_EV_STATE, &w->now);
}

void wish(struct world *w, uint8_t wanted)
{
    w->session.wanted = wanted;
    w->session.state.goal_x_mm = wanted == VS_HOME ? 30000 : 0;
    w->homed |= wanted == VS_HOME;
    if (wanted == VS_RUN || wanted == VS_HOME)
        w->wished_ns = 0;
    else if (w->wished_ns == 0)
        w->wished_ns = w->now.base_ns;
}

/* The base's part in the action that the guard gave: its result, and what it does. */
static int respond(struct world *w)
{
    static const struct vs_base_command off;

    if (w->action == VS_GUARD_RECOVER) {
        w->base = off;
        w->unapplied = 0;
        return VS_OK;
    }
    if (w->unapplied)
        return VS_ERR_SILENT;
    w->unapplied = w->fault && draw(&w->random, 2);
    if (!w->unapplied)
        w->base = w->guard.command;
    return w->fault ? VS_ERR_LATE : VS_OK;
}

/* How long that takes; draws whether it goes wrong. */
static uint64_t duration_ns(struct world *w)
{
    w->fault = w->fault_one_in != 0 && draw(&w->random, w->fault_one_in) == 0;
    if (w->action == VS_GUARD_RECOVER)
        return RECOVER_NS;
    if (w->unapplied)
        return SILENT_NS;
    return w->fault ? LATE_NS : EXCHANGE_NS;
}

static void serve_guard(struct world *w)
{
    struct vs_guard_request request;
    struct vs_guard_reply reply;
    struct vs_base_reading reading;

    memset(&reading, 0, sizeof reading);
    reading.max_steps_s = w->max_steps_s;
    if (w->answer_ns != 0 && w->now.base_ns >= w->answer_ns) {
        w->guard.reading = reading;
        w->answer_ns = 0;
        vs_guard_done(&w->guard, respond(w), w->now.base_ns);
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
        w->answer_ns = w->now.base_ns + duration_ns(w);
}

int turning(const struct world *w)
{
    return w->base.left_steps_s != 0 || w->base.right_steps_s != 0;
}

static void check_always(struct world *w)
{
    struct vs_telemetry telemetry;
    enum vs_telling telling;
    uint64_t now_ns = w->now.base_ns;
    uint64_t mend_ns = w->fault_one_in ? 2 * LATE_NS + SILENT_NS + RECOVER_NS : 0;

    if (turning(w) && w->session.params[0] != '\0') {
        CHECK(w->base.left_steps_s == 384); /* vs:v_max, the only parameter that is given */
    } else if (turning(w) && w->homed && w->base.leds == 0) {
        CHECK(w->base.left_steps_s == 930 && w->base.right_steps_s == 930);
    } else if (turning(w)) {
        CHECK(w->base.left_steps_s == (w->max_steps_s > 0 ? w->max_steps_s : 1000));
        CHECK(w->base.right_steps_s == -300);
    }
    if (turning(w)) {
        CHECK(now_ns < w->fresh_ns + VS_SAFETY_SILENCE_NS + 3 * EXCHANGE_NS + mend_ns);
        CHECK(w->wished_ns == 0 || now_ns < w->wished_ns + 50 * MS + mend_ns);
    }
    if (stepped_ns != w->last_step_ns) {
        CHECK(w->steps == 0 || w->loop.step_ns - w->begun_ns >= w->timestep_ns / 2);
        w->begun_ns = w->loop.step_ns;
        w->last_step_ns = stepped_ns;
        w->steps++;
        CHECK(w->loop.step.number == w->steps);
    }
    telling = vs_loop_telemetry(&w->loop, &w->now, &telemetry);
    CHECK(telling != VS_TELL_AGAIN || w->told_cause == vs_loop_cause(&w->loop, &w->now));
    CHECK(telling != VS_TELL_AGAIN || w->told_run == w->session.run);
    if (telling != VS_TELL_NOTHING) {
        CHECK(telling == VS_TELL_NEWS || !w->copied);
        w->copied = telling == VS_TELL_AGAIN;
        w->telemetry_ns = now_ns;
    }
    if (telling == VS_TELL_NEWS) {
        w->told_cause = telemetry.stop_cause;
        w->told_run = w->session.run;
        CHECK(telemetry.stop_cause != VS_CAUSE_NONE || telemetry.state == VS_RUN ||
              telemetry.state == VS_HOME);
        CHECK(telemetry.state != VS_RUN || w->session.wanted == VS_RUN);
        CHECK(telemetry.state != VS_HOME || w->session.wanted == VS_HOME);
        CHECK(w->homed || telemetry.control_step <= w->steps);
    }
    CHECK(!w->session.open || now_ns - w->telemetry_ns <= VS_LOOP_REPORT_NS + MS);
}

void live(struct world *w)
{
    serve_guard(w);
    check_always(w);
    w->now.base_ns += MS;
    w->now.session_ns += MS;
}

void live_for(struct world *w, uint64_t ns)
{
    uint64_t until_ns = w->now.base_ns + ns;

    while (w->now.base_ns < until_ns)
        live(w);
}

/* A host as it should be, for ns. */
void good_host(struct world *w, uint64_t ns)
{
    uint64_t until_ns = w->now.base_ns + ns;

    while (w->now.base_ns < until_ns) {
        if (w->now.base_ns % (50 * MS) == 20 * MS)
            receive(w, w->now.base_ns % (100 * MS) == 20 * MS);
        live(w);
    }
}
