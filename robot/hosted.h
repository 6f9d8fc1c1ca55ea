/* SPDX-License-Identifier: MIT */
/*
 * hosted.h - robots of inprocess.h whose controllers are no C: whoever has loaded the shared
 * object reads all robots at once before a control step, decides, and sets what they do. What
 * controller.h says of its functions holds for those here; a sensor, an actuator and a parameter
 * are bound before the first control step. Rows are in the order of the robots.
 */
#ifndef VS_HOSTED_H
#define VS_HOSTED_H

#include "inprocess.h"

#ifdef __GNUC__
#pragma GCC visibility push(default)
#endif

/* The robots are as in the control step of this timestep, which vs_inprocess_step makes next. */
void vs_hosted_sense(struct vs_inprocess *all, const struct vs_inprocess_timestep *now);

/* Binds a sensor, or a virtual actuator, for all robots. */
int vs_hosted_sensor(struct vs_inprocess *all, const char *name);
int vs_hosted_actuator(struct vs_inprocess *all, const char *name);

/* A sensor of all robots: values [robots * count], 0 where it is not known or has fewer; ages_ns
 * [robots] since each was measured, UINT64_MAX: it is not known; stale [robots]. */
void vs_hosted_read(const struct vs_inprocess *all, int sensor, int count, double *values,
                    uint64_t *ages_ns, uint8_t *stale);

/* What robots do from now on, those whose row in wanted [robots] is not 0. steps_s: [robots * 2]
 * left and right; leds: [robots]; values: [robots * count], the first numbers of an actuator. */
void vs_hosted_wheels(struct vs_inprocess *all, const uint8_t *wanted, const int32_t *steps_s);
void vs_hosted_leds(struct vs_inprocess *all, const uint8_t *wanted, const uint32_t *leds);
void vs_hosted_actuate(struct vs_inprocess *all, const uint8_t *wanted, int actuator, int count,
                       const double *values);

/* The next random number of each robot that is wanted. */
void vs_hosted_random(struct vs_inprocess *all, const uint8_t *wanted, double *values);

/* Of one robot. */
void vs_hosted_show(struct vs_inprocess *all, uint32_t robot, const char *name, double value);
void vs_hosted_show_text(struct vs_inprocess *all, uint32_t robot, const char *name,
                         const char *text);
void vs_hosted_log(struct vs_inprocess *all, uint32_t robot, const char *line);
double vs_hosted_param(struct vs_inprocess *all, uint32_t robot, const char *name, double fallback);
double vs_hosted_param_in(struct vs_inprocess *all, uint32_t robot, const char *name,
                          double fallback, int least, int most);
int vs_hosted_param_text(struct vs_inprocess *all, uint32_t robot, const char *name, char *text,
                         size_t size);

/* walk.h of all robots, in walks, as many bytes as vs_hosted_walk_bytes, aligned for any type.
 * Begins it, once; and one control step. does [robots]: 0 nothing, 1 wander, 2 towards
 * bearings_rad [robots], 3 rest. It sets the wheels of those that do something. */
size_t vs_hosted_walk_bytes(const struct vs_inprocess *all);
void vs_hosted_walk_begin(struct vs_inprocess *all, void *walks);
void vs_hosted_walk(struct vs_inprocess *all, void *walks, const uint8_t *does,
                    const double *bearings_rad);

#ifdef __GNUC__
#pragma GCC visibility pop
#endif

/* Of inprocess.c: how many there are, and what is behind one of them. */
struct vs_robot *vs_inprocess_robot(const struct vs_inprocess *all, uint32_t robot);
uint32_t vs_inprocess_robots(const struct vs_inprocess *all);

#endif
