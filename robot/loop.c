/* SPDX-License-Identifier: MIT */
#include "loop.h"

#include <string.h>

void vs_loop_init(struct vs_loop *loop, struct vs_session *session,
                  const struct vs_controller *controller, void *state)
{
    memset(loop, 0, sizeof *loop);
    loop->session = session;
    loop->controller = controller;
    loop->state = state;
    loop->robot.session = session;
    loop->base_lost = 1;
    loop->hold_due = 1;
    loop->robot.base.battery_low = VS_UNKNOWN;
    vs_safety_init(&loop->safety);
}

static uint64_t period_ns(const struct vs_loop *loop)
{
    return loop->session->open ? loop->session->timestep_ns : VS_LOOP_IDLE_NS;
}

/* What the wheels shall turn for, as the newest STATE says it; 0: they shall not. */
static uint8_t wanted_to_run(const struct vs_loop *loop)
{
    const struct vs_session *s = loop->session;
    int runs = s->wanted == VS_RUN && s->timestep >= s->from_timestep;

    return s->open && !loop->ending && (runs || s->wanted == VS_HOME) ? s->wanted : 0;
}

static int may_move(const struct vs_loop *loop, uint64_t base_ns)
{
    return loop->running && !loop->base_lost && !loop->battery.empty &&
           vs_safety_may_move(&loop->safety, base_ns);
}

static void look_at_wish(struct vs_loop *loop)
{
    uint8_t running = wanted_to_run(loop);

    if (running != loop->running) {
        loop->running = running;
        loop->holding = 0;
        memset(&loop->homing, 0, sizeof loop->homing);
        loop->begin_ns = loop->step_ns; /* an idle exchange delays no step */
        loop->hold_due = 1;
        loop->telemetry_due = VS_TELL_NEWS;
        loop->pacing = 0;
    }
    if (running != VS_RUN && (!loop->session->open || loop->session->wanted != VS_PAUSE))
        vs_robot_rest(&loop->robot);
}

/* Datagrams that waited while this process slept, or long on their way, are newer, but not
 * fresh. */
static int is_old(const struct vs_session *s, const struct vs_instant *now)
{
    return s->clock.samples != 0 &&
           vs_session_age_ns(s, s->newest_capture_ns, now->session_ns) > VS_SAFETY_SILENCE_NS;
}

/* Follows the host's timesteps. One that is far from where it is expected is where they are from
 * now on; otherwise early ones count for more, so that the base is mostly read in time. */
static void follow_host(struct vs_loop *loop, uint64_t now_ns)
{
    uint64_t timestep_ns = loop->session->timestep_ns;
    uint64_t late_ns = now_ns - loop->expected_ns;
    uint64_t early_ns = loop->expected_ns - now_ns;

    if (late_ns <= timestep_ns / 8)
        loop->expected_ns += late_ns / 8;
    else if (early_ns <= timestep_ns / 8)
        loop->expected_ns -= early_ns / 2;
    else
        loop->expected_ns = now_ns;
    loop->expected_ns += timestep_ns;
}

static void look_at_state(struct vs_loop *loop, const struct vs_instant *now)
{
    const struct vs_session *s = loop->session;

    if (s->fresh_ns != loop->seen_fresh_ns) {
        loop->seen_fresh_ns = s->fresh_ns;
        if (!is_old(s, now))
            vs_safety_fresh(&loop->safety, now->base_ns);
    }
    if (s->timestep != loop->seen_timestep || s->run != loop->seen_run) {
        loop->seen_timestep = s->timestep;
        loop->seen_run = s->run;
        loop->timestep_new = 1;
        follow_host(loop, now->base_ns);
    }
    /* The process is awake now, and need not wake up soon for this alone; a step tells, too. */
    if ((!loop->timestep_new || !loop->running) &&
        now->base_ns - loop->telemetry_ns >= VS_LOOP_TELEMETRY_NS / 2 &&
        loop->telemetry_due == VS_TELL_NOTHING)
        loop->telemetry_due = VS_TELL_AGAIN;
}

/* A controller lives as long as its run, its table, its seed and its parameters. Which run
 * it is the first STATE of a session tells. */
static int is_same_run(const struct vs_loop *loop)
{
    const struct vs_session *s = loop->session;

    return loop->begun && loop->offer == s->offer && loop->seed == s->seed &&
           (s->received_ns == 0 || loop->run == s->run);
}

/* What another run's controller did and showed is not this run's. */
static void look_at_run(struct vs_loop *loop)
{
    if (!is_same_run(loop))
        vs_robot_forget(&loop->robot);
}

static void end_run(struct vs_loop *loop)
{
    if (!loop->begun)
        return;
    loop->begun = 0;
    if (loop->controller->end != NULL)
        loop->controller->end(loop->state, &loop->robot);
}

void vs_loop_event(struct vs_loop *loop, enum vs_event event, const struct vs_instant *now)
{
    if (event == VS_EV_OPEN) {
        vs_safety_init(&loop->safety);
        loop->v_max_nm_s = vs_safety_v_max_nm_s(&loop->robot);
        loop->seen_fresh_ns = 0;
        loop->telemetry_due = VS_TELL_NEWS;
    }
    if (event == VS_EV_GOODBYE)
        end_run(loop);
    if (event == VS_EV_STATE) {
        look_at_state(loop, now);
        vs_log_heard(&loop->robot.log, loop->session->state.log_heard);
    }
    look_at_run(loop);
    look_at_wish(loop);
}

/* In line: of its two callers a daemon has one. */
static inline void begin_run(struct vs_loop *loop)
{
    const struct vs_session *s = loop->session;

    if (is_same_run(loop))
        return;
    end_run(loop);
    loop->talk_due = loop->offer != s->offer;
    vs_robot_begin(&loop->robot, s);
    (void)vs_safety_v_max_nm_s(&loop->robot); /* it was asked for, by no controller */
    memset(loop->state, 0, loop->controller->state_size);
    loop->controller->init(loop->state, &loop->robot);
    loop->begun = 1;
    loop->run = s->run;
    loop->offer = s->offer;
    loop->seed = s->seed;
}

void vs_loop_begin(struct vs_loop *loop)
{
    begin_run(loop);
}

/* A step of the walk home: the controller knows nothing of it, and the LEDs are off. */
static void walk_home(struct vs_loop *loop, const struct vs_instant *now)
{
    const struct vs_session *s = loop->session;
    uint64_t age_ns = vs_session_age_ns(s, s->capture_ns, now->session_ns);
    int16_t most = vs_safety_max_steps_s(&loop->robot.base, loop->v_max_nm_s);

    loop->timestep_new = 0;
    loop->command = loop->robot.command;
    vs_homing_steer(&loop->homing, &s->state, age_ns, now->base_ns, &loop->command);
    vs_safety_slow(&loop->command, loop->v_max_nm_s, most);
    vs_safety_limit(&loop->command, may_move(loop, now->base_ns), most);
    vs_homing_note(&loop->homing, &loop->command, now->base_ns);
    if (loop->calibration != NULL)
        vs_calibration_drive(loop->calibration, &loop->command, most);
    loop->acting = 1;
}

static void run_controller(struct vs_loop *loop, const struct vs_instant *now)
{
    struct vs_step *step = &loop->step;
    int16_t most = vs_safety_max_steps_s(&loop->robot.base, loop->v_max_nm_s);

    begin_run(loop);
    loop->timestep_new = 0;
    loop->robot.session_ns = now->session_ns;
    loop->robot.now_ns = now->base_ns;
    vs_robot_begin_step(&loop->robot);
    if (loop->robot.failure[0] == '\0')
        loop->controller->step(loop->state, &loop->robot);
    if (loop->robot.failure[0] != '\0')
        memset(&loop->robot.command, 0, sizeof loop->robot.command);
    loop->command = loop->robot.command;
    vs_safety_slow(&loop->command, loop->v_max_nm_s, most);
    if (loop->calibration != NULL)
        vs_calibration_drive(loop->calibration, &loop->command, most);
    vs_safety_limit(&loop->command, may_move(loop, now->base_ns), most);
    step->number++;
    step->session_ns = now->session_ns;
    step->age_ns = vs_session_age_ns(loop->session, loop->session->capture_ns, now->session_ns);
    step->stale = (uint8_t)vs_robot_is_stale(loop->session, step->age_ns);
    step->command = loop->command;
    loop->trace_due = 1;
    loop->acting = 1;
}

void vs_loop_reply(struct vs_loop *loop, const struct vs_guard_reply *reply,
                   const struct vs_instant *now)
{
    loop->waiting = 0;
    loop->base_lost = reply->lost;
    loop->holding = loop->holding && !reply->lost;
    loop->guard_cause = reply->cause;
    loop->applied = reply->command;
    if (reply->sensed) {
        memcpy(&loop->robot.base, &reply->reading, VS_BASE_OWN);
        loop->robot.base_ns = reply->reading_ns;
        if (loop->calibration != NULL)
            vs_calibration_sense(loop->calibration, &loop->robot.base, loop->robot.raw);
        vs_battery_look(&loop->battery, vs_base_battery_mv(&loop->robot.base),
                        vs_base_battery_low(&loop->robot.base), now->base_ns);
    }
    if (reply->kind == VS_GUARD_SENSE && reply->sensed)
        loop->lead_ns = reply->reading_ns - loop->sent_ns + VS_LOOP_WAKE_NS;
    if (reply->kind == VS_GUARD_SENSE && loop->running && !loop->base_lost)
        loop->holding = 1;
    if (reply->kind == VS_GUARD_ACT) {
        if (loop->acting && (reply->result == VS_OK || reply->result == VS_ERR_LATE))
            loop->completed++;
        loop->acting = 0;
        loop->guard_lost = 0;
        loop->telemetry_due = VS_TELL_NEWS;
    }
}

void vs_loop_guard_lost(struct vs_loop *loop)
{
    memset(&loop->applied, 0, sizeof loop->applied);
    loop->waiting = 0;
    loop->acting = 0;
    loop->holding = 0;
    loop->guard_lost = 1;
    loop->telemetry_due = VS_TELL_NEWS;
}

void vs_loop_end(struct vs_loop *loop)
{
    loop->ending = 1;
    end_run(loop);
    look_at_wish(loop);
}

static int is_asked(const struct vs_loop *loop, enum vs_guard_kind what)
{
    return loop->waiting && loop->asked == what;
}

/* When the next control step, or idle exchange, begins; while the base is read for one or has been,
 * when the controller is called. */
static uint64_t next_step_ns(const struct vs_loop *loop)
{
    uint64_t period, early_ns;

    if (loop->holding || (loop->running && is_asked(loop, VS_GUARD_SENSE)))
        return loop->timestep_new ? 0 : loop->hold_ns;
    period = period_ns(loop);
    if (!loop->running)
        return loop->begin_ns + period;
    if (loop->timestep_new)
        return loop->begin_ns + period / 2;
    early_ns = loop->expected_ns - loop->lead_ns - loop->begin_ns; /* after the step before */
    if (early_ns > period / 2 && early_ns < period + period / 4)
        return loop->begin_ns + early_ns;
    return loop->begin_ns + period + period / 4;
}

/* The base is read. Calls the controller once what it waits for is there, or late. */
static void end_hold(struct vs_loop *loop, const struct vs_instant *now)
{
    if (!loop->holding || now->base_ns < next_step_ns(loop))
        return;
    loop->holding = 0;
    if (!loop->timestep_new)
        loop->expected_ns += loop->session->timestep_ns;
    (loop->running == VS_RUN ? run_controller : walk_home)(loop, now);
}

static void begin_step(struct vs_loop *loop, uint64_t now_ns)
{
    uint64_t period = period_ns(loop);

    if (loop->pacing && now_ns - loop->step_ns > 3 * period / 2)
        loop->overruns++;
    /* As late as it would be if the base were read only then; at once where it is late already. */
    loop->hold_ns = loop->begin_ns + period + period / 4 + loop->lead_ns;
    loop->pacing = 1;
    loop->step_ns = now_ns;
    loop->begin_ns = now_ns;
}

static void give_act(struct vs_loop *loop, struct vs_guard_request *request)
{
    request->kind = VS_GUARD_ACT;
    request->number = 0;
    request->command = loop->command;
    request->expiry_ns = vs_safety_expiry_ns(&loop->safety);
}

/* Wheels 0; LEDs off too unless the host wants a pause. */
static void give_hold(struct vs_loop *loop, struct vs_guard_request *request)
{
    loop->command = loop->robot.command;
    vs_safety_limit(&loop->command, 0, 0);
    loop->hold_due = 0;
    loop->acting = 0;
    give_act(loop, request);
}

int vs_loop_request(struct vs_loop *loop, const struct vs_instant *now,
                    struct vs_guard_request *request)
{
    int sensing;
    int pinging;

    if (loop->waiting)
        return 0;
    end_hold(loop, now);
    sensing = !loop->acting && now->base_ns >= next_step_ns(loop);
    pinging = now->base_ns - loop->sent_ns >= VS_LOOP_PING_NS / 2; /* while awake anyway */
    if (!loop->acting)
        memset(request, 0, sizeof *request);
    if (loop->ending) {
        request->kind = VS_GUARD_CLOSE;
    } else if (!loop->running && loop->hold_due) {
        give_hold(loop, request);
    } else if (loop->acting && loop->running) {
        give_act(loop, request);
    } else if (sensing) {
        if (loop->running) {
            begin_step(loop, now->base_ns);
            request->kind = VS_GUARD_SENSE;
        } else {
            loop->begin_ns = now->base_ns;
            give_hold(loop, request);
        }
    } else if (pinging) {
        request->kind = VS_GUARD_PING;
    } else {
        return 0;
    }
    loop->waiting = 1;
    loop->asked = (uint8_t)request->kind;
    loop->sent_ns = now->base_ns;
    return 1;
}

int vs_loop_is_answered(const struct vs_loop *loop, const struct vs_instant *now)
{
    return is_asked(loop, VS_GUARD_PING) ||
           (is_asked(loop, VS_GUARD_SENSE) &&
            now->base_ns - loop->sent_ns + VS_LOOP_WAKE_NS >= loop->lead_ns);
}

int vs_loop_is_patient(const struct vs_loop *loop, const struct vs_instant *now)
{
    return (is_asked(loop, VS_GUARD_PING) || is_asked(loop, VS_GUARD_SENSE)) && loop->running &&
           now->base_ns < next_step_ns(loop);
}

uint64_t vs_loop_wake_ns(const struct vs_loop *loop, const struct vs_instant *now)
{
    uint64_t wake_ns = UINT64_MAX;

    if (!loop->waiting || vs_loop_is_patient(loop, now))
        wake_ns = next_step_ns(loop);
    if (!loop->waiting && loop->sent_ns + VS_LOOP_PING_NS < wake_ns)
        wake_ns = loop->sent_ns + VS_LOOP_PING_NS;
    if (loop->session->open && vs_loop_telemetry_ns(loop) < wake_ns)
        wake_ns = vs_loop_telemetry_ns(loop);
    return wake_ns;
}
