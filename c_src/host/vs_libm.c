/* SPDX-License-Identifier: MIT */
#include "vs_libm.h"

#include <math.h>

#include "vs_math.h"

void vs_libm_direction(double angle_rad, double *cosine, double *sine)
{
    *cosine = cos(angle_rad);
    *sine = sin(angle_rad);
}

double vs_libm_exp(double exponent)
{
    return exp(exponent);
}

double vs_libm_bearing(double y, double x)
{
    return atan2(y, x);
}

double vs_libm_root(double value)
{
    return sqrt(value);
}

double vs_libm_distance(double x, double y)
{
    return hypot(x, y);
}

double vs_libm_wrap(double angle_rad)
{
    double rest = VS_PI - angle_rad;
    double wrapped;

    if (!(fabs(rest) < 2.0 * VS_PI)) /* else it is its own remainder */
        rest = fmod(rest, 2.0 * VS_PI);
    if (rest < 0.0)
        rest += 2.0 * VS_PI;
    wrapped = VS_PI - rest;
    return wrapped > -VS_PI ? wrapped : VS_PI;
}
