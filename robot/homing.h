/* SPDX-License-Identifier: MIT */
/*
 * homing.h - the walk to a goal that the host names (PROTOCOL.md, section 11): the host plans the
 * way and sees the robot, the daemon turns its wheels. Between two goals, and for the time that
 * one was on its way, it reckons by what it told the wheels. Pure; times are the board's [ns].
 */
#ifndef VS_HOMING_H
#define VS_HOMING_H

#include "base.h"
#include "../c_src/vs_body.h"

#define VS_HOMING_LEGS 16          /* commands that are remembered: 0.4 s at 40 Hz */
#define VS_HOMING_LONGEST_MS 1000  /* [ms] what lies further back is not reckoned with */

/* What the wheels were told, until the next one. */
struct vs_leg {
    uint64_t from_ns;
    int16_t left_steps_s;
    int16_t right_steps_s;
};

/* All zeros: the robot stood still. */
struct vs_homing {
    struct vs_leg legs[VS_HOMING_LEGS];
    uint8_t newest;
};

/* Sets the wheels of *command for the goal of *state, which the host saw age_ns ago. */
void vs_homing_steer(const struct vs_homing *homing, const struct vs_state *state,
                     uint64_t age_ns, uint64_t now_ns, struct vs_base_command *command);

/* From now on the wheels are told this, as a nominal e-puck's. */
void vs_homing_note(struct vs_homing *homing, const struct vs_base_command *command,
                    uint64_t now_ns);

#endif
