/* SPDX-License-Identifier: MIT */
/*
 * vs_trig.h - sine and cosine without a mathematical library: the same bits on every
 * machine, so that a simulation repeats anywhere.
 */
#ifndef VS_TRIG_H
#define VS_TRIG_H

#define VS_TRIG_MAX_RAD 100000 /* [rad] beyond it the angle loses digits */

/* Both of an angle, to 2e-15 up to +-VS_TRIG_MAX_RAD. What is not finite counts as 0. */
void vs_sin_cos(double angle_rad, double *sine, double *cosine);

/* The same angle in (-pi, pi]; angles up to +-VS_TRIG_MAX_RAD. */
double vs_wrap_angle(double angle_rad);

#endif
