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

#include "robot.h"

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

/* [nm/s] how fast a wheel may be by the session's parameter vs:v_max [m/s]; UINT32_MAX: there is
 * none, 0: it is no number. */
uint32_t vs_safety_v_max_nm_s(struct vs_robot *robot);

/* [step/s] the highest speed to ask for under that limit: a base that does not tell its motors'
 * and its step is an e-puck's. */
int16_t vs_safety_max_steps_s(const struct vs_base_reading *base, uint32_t v_max_nm_s);

/* Where there is such a limit, *command slowed down to max_steps_s, both wheels alike: it keeps to
 * its curve. */
void vs_safety_slow(struct vs_base_command *command, uint32_t v_max_nm_s, int16_t max_steps_s);

#endif
