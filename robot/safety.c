/* SPDX-License-Identifier: MIT */
#include "safety.h"

#include "base_body.h"

#define MOTOR_HZ 10000u

void vs_safety_init(struct vs_safety *s)
{
    s->fresh_ns = 0;
    s->fresh = 0;
}

static int silent(const struct vs_safety *s, uint64_t now_ns)
{
    return s->fresh == 0 || now_ns >= vs_safety_expiry_ns(s);
}

void vs_safety_fresh(struct vs_safety *s, uint64_t now_ns)
{
    if (silent(s, now_ns))
        s->fresh = 0;
    if (s->fresh < VS_SAFETY_RESUME)
        s->fresh++;
    s->fresh_ns = now_ns;
}

int vs_safety_may_move(const struct vs_safety *s, uint64_t now_ns)
{
    return s->fresh == VS_SAFETY_RESUME && !silent(s, now_ns);
}

uint64_t vs_safety_expiry_ns(const struct vs_safety *s)
{
    return s->fresh_ns + VS_SAFETY_SILENCE_NS;
}

void vs_safety_limit(struct vs_base_command *command, int may_move, int16_t max_steps_s)
{
    int16_t most = may_move ? max_steps_s : 0;

    command->left_steps_s = vs_base_clamp(command->left_steps_s, most);
    command->right_steps_s = vs_base_clamp(command->right_steps_s, most);
}

uint32_t vs_safety_v_max_nm_s(struct vs_robot *robot)
{
    double v_max_m_s = vs_robot_param(robot, "vs:v_max", -1.0);

    if (vs_robot_param_text(robot, "vs:v_max", NULL, 0) < 0)
        return UINT32_MAX;
    return v_max_m_s > 0.0 && v_max_m_s < 4.0 ? (uint32_t)(v_max_m_s * 1e9) : 0;
}

/* An e-puck's motors step at a whole divisor of 10 kHz, the next one above what is asked for: up
 * to 10 % faster. Source: epuck.md 6. */
int16_t vs_safety_max_steps_s(const struct vs_base_reading *base, uint32_t v_max_nm_s)
{
    int16_t motors_steps_s = base->max_steps_s > 0 ? base->max_steps_s : VS_ROBOT_MAX_STEPS_S;
    uint32_t most;

    if (v_max_nm_s == UINT32_MAX) /* mostly, and a division is dear */
        return motors_steps_s;
    most = v_max_nm_s / (base->step_nm > 0 ? base->step_nm : VS_EPUCK_STEP_NM);
    if (most >= (uint32_t)motors_steps_s)
        return motors_steps_s;
    if (most == 0)
        return 0;
    return (int16_t)(MOTOR_HZ / ((MOTOR_HZ + most - 1) / most));
}

static int32_t magnitude(int16_t steps_s)
{
    return steps_s < 0 ? -(int32_t)steps_s : steps_s;
}

void vs_safety_slow(struct vs_base_command *command, uint32_t v_max_nm_s, int16_t max_steps_s)
{
    int32_t left = magnitude(command->left_steps_s), right = magnitude(command->right_steps_s);
    int32_t fastest = left > right ? left : right;

    if (v_max_nm_s == UINT32_MAX || fastest <= max_steps_s)
        return;
    command->left_steps_s = (int16_t)(command->left_steps_s * max_steps_s / fastest);
    command->right_steps_s = (int16_t)(command->right_steps_s * max_steps_s / fastest);
}
