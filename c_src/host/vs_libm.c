/* SPDX-License-Identifier: MIT */
#include "vs_libm.h"

#include <math.h>

void vs_libm_direction(double angle_rad, double *cosine, double *sine)
{
    *cosine = cos(angle_rad);
    *sine = sin(angle_rad);
}

double vs_libm_exp(double exponent)
{
    return exp(exponent);
}
