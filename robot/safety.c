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

void vs_safety_limit(struct vs_base_command *command, int may_move, int16_t max_steps_s)
{
    int16_t most = may_move ? max_steps_s : 0;

    command->left_steps_s = vs_base_clamp(command->left_steps_s, most);
    command->right_steps_s = vs_base_clamp(command->right_steps_s, most);
}
