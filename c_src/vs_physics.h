/* SPDX-License-Identifier: MIT */
/*
 * vs_physics.h - the floor of lab and simulation: robots that drive by stepper motors,
 * bodies and boxes that stand, and nobody inside anybody. Time is an argument: the same
 * calls give the same bits.
 */
#ifndef VS_PHYSICS_H
#define VS_PHYSICS_H

#include "vs_contacts.h"

#define VS_TICK_NS 10000000       /* [ns] contacts are looked at this often */
#define VS_MAX_STEPS_S 1000       /* [step/s] faster commands count as that; epuck.md 1.3 */
#define VS_STEPPER_HZ 10000       /* the motor library counts time in such ticks; epuck.md 1.6 */

extern const double vs_axle_m; /* [m] between the wheels' contact points; epuck.md 6 */
extern const double vs_step_m; /* [m] a wheel's way per motor step: 41 mm wheels, 1000 steps */

/* All arrays are the caller's. */
struct vs_physics {
    struct vs_contacts *contacts; /* and with it who is near whom */
    double *poses;       /* [bodies * 3] x_m, y_m, yaw_rad; robots first */
    double *mobility;    /* [bodies] that of contacts: set for robots, 0 for what stands */
    double *wheels_m_s;  /* [robots * 2] what the wheels do, left and right */
    int16_t *commands;   /* [robots * 2] newest commands [step/s] */
    int64_t *rolled_ns;  /* [robots] their poses hold for this time but for contacts */
    int64_t tick_ns;     /* time of the newest tick */
};

/* Speed over ground of a wheel [m/s] that was commanded to turn at steps_s: the stepper
 * makes a step every whole number of its timer's ticks. */
double vs_wheel_m_s(int steps_s);

/* A scene at rest at time_ns; all but commands, wheels_m_s, rolled_ns and the robots'
 * mobility is set. */
void vs_physics_init(struct vs_physics *physics, int64_t time_ns);

/* Lets a robot's wheels turn at new speeds from time_ns on; a time before the newest tick
 * counts as the time of that tick: the past stays as it is. */
void vs_physics_drive(struct vs_physics *physics, uint32_t robot, int left_steps_s,
                      int right_steps_s, int64_t time_ns);

/* vs_physics_drive for all robots; commands [robots * 2], left and right. */
void vs_physics_drive_all(struct vs_physics *physics, const int16_t *commands,
                          int64_t time_ns);

/* Moves everything on to time_ns, later than all calls before. */
void vs_physics_tick(struct vs_physics *physics, int64_t time_ns);

/* Ticks every VS_TICK_NS up to time_ns, the last one there; none if it is not later. */
void vs_physics_advance(struct vs_physics *physics, int64_t time_ns);

#endif
