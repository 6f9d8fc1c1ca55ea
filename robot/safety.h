/* SPDX-License-Identifier: MIT */
/*
 * safety.h - what the worker may ask the wheels for. It can only take motion away:
 * no output is larger than its input or turns the other way. Pure.
 *
 * Fresh = a newer sequence whose capture time advanced and is not older than
 * VS_SAFETY_SILENCE_NS: neither a frozen tracker nor datagrams that piled up while
 * this process slept keep wheels turning. Times are of the board's clock [ns].
 */
#ifndef VS_SAFETY_H
#define VS_SAFETY_H

#include "base.h"
#include "controller.h"

#define VS_SAFETY_SILENCE_NS 400000000u /* [ns] after the last fresh state: wheels 0 */
#define VS_SAFETY_RESUME 3              /* fresh states in a row that end a silence */

struct vs_safety {
    uint64_t fresh_ns; /* newest fresh state, 0 = none */
    uint8_t fresh;     /* in a row without a silence, up to VS_SAFETY_RESUME */
};

void vs_safety_init(struct vs_safety *s);

/* A fresh state came at now_ns. */
void vs_safety_fresh(struct vs_safety *s, uint64_t now_ns);

/* 1 if wheels may turn at now_ns, as far as freshness goes. */
int vs_safety_may_move(const struct vs_safety *s, uint64_t now_ns);

/* When a command given now has to end. */
uint64_t vs_safety_expiry_ns(const struct vs_safety *s);

/* *command limited to +-max_steps_s, what the motors can do, or to speed 0 if not may_move. */
void vs_safety_limit(struct vs_base_command *command, int may_move, int16_t max_steps_s);

#endif
