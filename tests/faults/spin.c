/* SPDX-License-Identifier: MIT */
/*
 * spin.c - turns on the spot, always: a wheel that stands was stopped by somebody else, and
 * a wheel that turns at another speed was told so by somebody else.
 */
#include "controller.h"

#define SPEED 300 /* [step/s] */

static void init(void *state, struct vs_robot *robot)
{
    (void)state;
    (void)vs_robot_sensor(robot, "pollutant");
}

static void step(void *state, struct vs_robot *robot)
{
    (void)state;
    vs_robot_set_wheels(robot, -SPEED, SPEED);
}

const struct vs_controller vs_controller = {"spin", 1, init, step, NULL};
