/* SPDX-License-Identifier: MIT */
/*
 * stand_still.c - robots that do nothing: what drives them where an experiment file
 * names a program that runs on no robot, such as a C++ library for ARGoS. What their host has set
 * stays, see hosted.h.
 */
#include "controller.h"

static void init(void *state, struct vs_robot *robot)
{
    (void)state;
    vs_robot_set_wheels(robot, 0, 0);
}

static void step(void *state, struct vs_robot *robot)
{
    (void)state;
    (void)robot;
}

const struct vs_controller vs_controller = {"stand_still", 1, init, step, NULL};
