/* SPDX-License-Identifier: MIT */
/*
 * vs_libm.h - the C library's mathematics, which is NumPy's: for kernels that took over from NumPy
 * and give the same bits. Its last digits are those of the machine; whoever begins anew takes
 * vs_math.h. Angles in rad.
 */
#ifndef VS_LIBM_H
#define VS_LIBM_H

/* The unit vector of a direction: numpy.cos and numpy.sin. */
void vs_libm_direction(double angle_rad, double *cosine, double *sine);

/* numpy.exp; where NumPy has wider instructions for it, the last bit may differ. */
double vs_libm_exp(double exponent);

/* numpy.arctan2; likewise. */
double vs_libm_bearing(double y, double x);

/* numpy.sqrt and numpy.hypot. */
double vs_libm_root(double value);
double vs_libm_distance(double x, double y);

/* wrap_angle of vsense/base/arena.py: the same angle in (-pi, pi]. */
double vs_libm_wrap(double angle_rad);

#endif
