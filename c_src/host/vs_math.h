/* SPDX-License-Identifier: MIT */
/*
 * vs_math.h - the arithmetic that the kernels share, without a mathematical library: the
 * same bits on every machine, so that a simulation repeats anywhere.
 */
#ifndef VS_MATH_H
#define VS_MATH_H

#define VS_PI 3.14159265358979323846
#define VS_ANGLE_MAX_RAD 100000 /* [rad] beyond it the angle loses digits */

static inline double vs_least(double a, double b)
{
    return a < b ? a : b;
}

static inline double vs_most(double a, double b)
{
    return a > b ? a : b;
}

/* 0 for what is not finite, too. */
static inline int vs_is_within(double value, double low, double high)
{
    return value >= low && value <= high;
}

/* Square root of a number >= 0; 0 for anything else. */
double vs_root(double value);

/* Both of an angle, to 2e-15 up to +-VS_ANGLE_MAX_RAD. What is not finite counts as 0. */
void vs_sin_cos(double angle_rad, double *sine, double *cosine);

/* e to the power of a number <= 0, to 1e-15 of it; 0 below -700, 1 for what is not <= 0. */
double vs_decay(double exponent);

/* Angle of the direction (x, y), in [-pi, pi], to 5e-16; 0 for (0, 0). Finite numbers. */
double vs_bearing(double y, double x);

/* The same angle in (-pi, pi]; angles up to +-VS_ANGLE_MAX_RAD. */
double vs_wrap_angle(double angle_rad);

#endif
