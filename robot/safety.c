/* SPDX-License-Identifier: MIT */
#include "safety.h"

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

static int16_t clamp(int16_t steps_s)
{
    if (steps_s > VS_ROBOT_MAX_STEPS_S)
        return VS_ROBOT_MAX_STEPS_S;
    return steps_s < -VS_ROBOT_MAX_STEPS_S ? -VS_ROBOT_MAX_STEPS_S : steps_s;
}

void vs_safety_limit(struct vs_base_command *command, int may_move)
{
    command->left_steps_s = may_move ? clamp(command->left_steps_s) : 0;
    command->right_steps_s = may_move ? clamp(command->right_steps_s) : 0;
}
