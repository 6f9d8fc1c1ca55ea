/* SPDX-License-Identifier: MIT */
/*
 * layer.h - what a layer over controller.h needs besides, which gives controllers another
 * interface: argos/ is one. Controllers themselves include controller.h only.
 */
#ifndef VS_LAYER_H
#define VS_LAYER_H

#include "controller.h"

#ifdef __cplusplus
extern "C" {
#endif

/* All parameters as the host sent them, lines "key=value\n"; none of them is complained of as
 * unknown any more. Valid until init or step returns. */
const char *vs_robot_params(struct vs_robot *robot);

/* 1 if the robot's own hardware measures what the sensor reads, alone or fused with a virtual
 * one; 0 if the host sends it, or nobody does. */
int vs_robot_is_own(int sensor);

/* 1 if the host's table has a virtual actuator of that name. */
int vs_robot_has_actuator(const struct vs_robot *robot, const char *name);

/* The controller cannot go on: its wheels and LEDs stay off and it is not called again in this
 * run. The words are logged, and end a simulation; the first ones count. */
void vs_robot_fail(struct vs_robot *robot, const char *words);

#ifdef __cplusplus
}
#endif

#endif
