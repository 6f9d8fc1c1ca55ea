/* SPDX-License-Identifier: MIT */
#include "robot.h"

#include <string.h>

#define STEP_NM 128805u    /* [nm] that an e-puck's wheel rolls in one motor step */
#define MOST_STEPS_S 1000u /* [step/s] of its motors */
#define MOTOR_HZ 10000u

int robot_init(struct robot *r, const struct vs_session_config *config)
{
    memset(r, 0, sizeof *r);
    r->telemetry.battery_low = VS_UNKNOWN;
    r->telemetry.power_saving = VS_UNKNOWN;
    r->telemetry.retries = VS_NEVER_US;
    return vs_session_init(&r->session, config);
}

void robot_connected(struct robot *r, const uint8_t *nonce, uint64_t now_ns)
{
    vs_session_connected(&r->session, nonce, (uint32_t)(now_ns / 1000000000u));
    r->greeted_ns = now_ns;
    r->fresh = 0;
    r->fresh_ns = 0;
}

int robot_is_lost(const struct robot *r, uint64_t now_ns)
{
    if (r->session.open)
        return now_ns - r->heard_ns > ROBOT_PATIENCE_NS;
    return now_ns - r->greeted_ns > ROBOT_AGAIN_NS;
}

/* [step/s] that keep to the parameter vs:v_max [m/s]; without one what the motors can do. They step
 * at a whole divisor of 10 kHz, the next one above what is asked for. */
static int16_t speed_limit(const char *params)
{
    static const char key[] = "vs:v_max=";
    const char *at = strstr(params, key);
    uint32_t um_s = 0, unit = 1000000, most;
    int is_fraction = 0;

    if (at == NULL)
        return MOST_STEPS_S;
    for (at += sizeof key - 1; *at != '\n' && *at != '\0'; at++) {
        if (*at == '.' && !is_fraction)
            is_fraction = 1;
        else if (*at < '0' || *at > '9' || um_s > 4000000)
            return 0; /* no number of a robot's speed: it stands */
        else if (!is_fraction)
            um_s = 10 * um_s + (uint32_t)(*at - '0') * 1000000;
        else
            um_s += (uint32_t)(*at - '0') * (unit /= 10);
    }
    most = um_s / (STEP_NM / 1000 + 1);
    if (most == 0 || most >= MOST_STEPS_S)
        return most == 0 ? 0 : MOST_STEPS_S;
    return (int16_t)(MOTOR_HZ / ((MOTOR_HZ + most - 1) / most));
}

/* A newer state counts only while its capture advances: a frozen tracker stops the robot. */
static void note(struct robot *r, enum vs_event event, uint64_t now_ns)
{
    if (event == VS_EV_NONE || event == VS_EV_DOUBTED)
        return;
    r->heard_ns = now_ns;
    if (event == VS_EV_OPEN)
        r->max_steps_s = speed_limit(r->session.params);
    if (event != VS_EV_STATE)
        return;
    r->stepped = 0;
    if (r->session.fresh_ns == r->fresh_ns)
        return;
    if (now_ns - r->fresh_ns > ROBOT_SILENCE_NS)
        r->fresh = 0;
    if (r->fresh < ROBOT_RESUME)
        r->fresh++;
    r->fresh_ns = r->session.fresh_ns;
}

int robot_bytes(struct robot *r, const uint8_t *bytes, size_t len, uint64_t now_ns)
{
    while (len > 0) {
        enum vs_event event;
        size_t used = 0;
        int err = vs_session_tcp_in(&r->session, bytes, len, now_ns, &used, &event);

        if (err != VS_OK)
            return err;
        note(r, event, now_ns);
        if (event == VS_EV_REFUSED || event == VS_EV_GOODBYE)
            return VS_ERR_STATE;
        bytes += used;
        len -= used;
    }
    return VS_OK;
}

void robot_datagram(struct robot *r, const uint8_t *bytes, size_t len, uint64_t now_ns)
{
    enum vs_event event;

    if (vs_session_udp_in(&r->session, bytes, len, now_ns, &event) == VS_OK)
        note(r, event, now_ns);
}

static int is_to_run(const struct robot *r)
{
    const struct vs_session *s = &r->session;

    return s->open && s->wanted == VS_RUN && s->timestep >= s->from_timestep;
}

static int may_move(const struct robot *r, uint64_t now_ns)
{
    return is_to_run(r) && r->fresh == ROBOT_RESUME && now_ns - r->fresh_ns <= ROBOT_SILENCE_NS;
}

static uint8_t stop_cause(const struct robot *r, uint64_t now_ns)
{
    if (!is_to_run(r))
        return VS_CAUSE_WANTED;
    return may_move(r, now_ns) ? VS_CAUSE_NONE : VS_CAUSE_STALE;
}

static size_t tell(struct robot *r, uint8_t *buf, uint64_t now_ns)
{
    struct vs_telemetry *t = &r->telemetry;
    size_t len = 0;

    r->told_ns = now_ns;
    robot_wheels(r, now_ns, &t->left_steps_s, &t->right_steps_s);
    t->state = is_to_run(r) ? VS_RUN : VS_IDLE;
    if (r->session.wanted == VS_PAUSE || r->session.wanted == VS_STOP)
        t->state = r->session.wanted;
    t->stop_cause = stop_cause(r, now_ns);
    (void)vs_session_telemetry(&r->session, t, now_ns, buf, VS_DATAGRAM_MAX, &len);
    return len;
}

size_t robot_packet(struct robot *r, uint8_t buf[VS_DATAGRAM_MAX], uint64_t now_ns,
                    int *is_telemetry)
{
    enum vs_event event;
    size_t len = 0;

    *is_telemetry = 0;
    if (vs_session_tcp_out(&r->session, buf, VS_DATAGRAM_MAX, now_ns, &len) == VS_OK && len > 0)
        return len;
    vs_session_tick(&r->session, now_ns, &event);
    if (!r->session.open || now_ns - r->told_ns < ROBOT_TELL_NS)
        return 0;
    *is_telemetry = 1;
    return tell(r, buf, now_ns);
}

static int16_t limited(int16_t steps_s, int16_t most)
{
    return steps_s > most ? most : steps_s < -most ? (int16_t)-most : steps_s;
}

void robot_wheels(struct robot *r, uint64_t now_ns, int16_t *left_steps_s,
                  int16_t *right_steps_s)
{
    int16_t most = may_move(r, now_ns) ? r->max_steps_s : 0;

    if (most > 0 && !r->stepped) {
        r->stepped = 1;
        r->telemetry.control_step++;
        controller_step(r);
    }
    *left_steps_s = limited(r->left_steps_s, most);
    *right_steps_s = limited(r->right_steps_s, most);
}
