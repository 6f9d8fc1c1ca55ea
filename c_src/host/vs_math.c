/* SPDX-License-Identifier: MIT */
#include "vs_math.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#define PER_QUARTER 0.63661977236758134308 /* 2 / pi */
#define MOST_QUARTERS 4e9                  /* the counts still fit 64 bits by far */

/* pi / 2 in three parts: the first two have so few digits that their multiples are exact.
 * Source: W. J. Cody, W. Waite: Software Manual for the Elementary Functions, 1980. */
#define QUARTER_1 1.57079632673412561417e+00
#define QUARTER_2 6.07710050630396597660e-11
#define QUARTER_3 2.02226624879595063154e-21

/* ln 2 likewise, in two parts; below the least exponent the power of 2 would have no exponent. */
#define PER_DOUBLING 1.44269504088896340736
#define DOUBLING_1 6.93147180369123816490e-01
#define DOUBLING_2 1.90821492927058770002e-10
#define LEAST_EXPONENT -700.0

static const double inverse_factorial[] = {
    1.0, 1.0, 1.0 / 2.0, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0, 1.0 / 720.0, 1.0 / 5040.0,
    1.0 / 40320.0, 1.0 / 362880.0, 1.0 / 3628800.0, 1.0 / 39916800.0, 1.0 / 479001600.0};

/* arctan(i / 8). */
static const double arctan_of_eighths[] = {
    0.0, 0.12435499454676144, 0.24497866312686414, 0.35877067027057225, 0.4636476090008061,
    0.5585993153435624, 0.6435011087932844, 0.7188299996216245, 0.7853981633974483};

/* Halving the exponent guesses to 4 %, and each of Newton's steps doubles the digits. */
double vs_root(double value)
{
    uint64_t bits;
    double root;
    int i;

    if (!(value > 1e-300 && value < 1e300))
        return 0.0;
    memcpy(&bits, &value, sizeof bits);
    bits = (bits >> 1) + 0x1FF8000000000000U;
    memcpy(&root, &bits, sizeof root);
    for (i = 0; i < 4; i++)
        root = 0.5 * (root + value / root);
    return root;
}

/* Nearest whole number. */
static int64_t nearest(double value)
{
    return (int64_t)(value < 0.0 ? value - 0.5 : value + 0.5);
}

/* Taylor's series; at pi/4 the first term left out is below 1e-17. */
static double sine_of_small(double x)
{
    double xx = x * x;
    double sum = -1.0 / 1307674368000.0;

    sum = sum * xx + 1.0 / 6227020800.0;
    sum = sum * xx - 1.0 / 39916800.0;
    sum = sum * xx + 1.0 / 362880.0;
    sum = sum * xx - 1.0 / 5040.0;
    sum = sum * xx + 1.0 / 120.0;
    sum = sum * xx - 1.0 / 6.0;
    return x + x * xx * sum;
}

static double cosine_of_small(double x)
{
    double xx = x * x;
    double sum = 1.0 / 20922789888000.0;

    sum = sum * xx - 1.0 / 87178291200.0;
    sum = sum * xx + 1.0 / 479001600.0;
    sum = sum * xx - 1.0 / 3628800.0;
    sum = sum * xx + 1.0 / 40320.0;
    sum = sum * xx - 1.0 / 720.0;
    sum = sum * xx + 1.0 / 24.0;
    return 1.0 - 0.5 * xx + xx * xx * sum;
}

void vs_sin_cos(double angle_rad, double *sine, double *cosine)
{
    double quarters = angle_rad * PER_QUARTER;
    int64_t quarter;
    double rest;
    double s;
    double c;

    if (!(quarters > -MOST_QUARTERS && quarters < MOST_QUARTERS)) {
        *sine = 0.0;
        *cosine = 1.0;
        return;
    }
    quarter = nearest(quarters);
    rest = angle_rad - (double)quarter * QUARTER_1;
    rest -= (double)quarter * QUARTER_2;
    rest -= (double)quarter * QUARTER_3;
    s = sine_of_small(rest);
    c = cosine_of_small(rest);
    *sine = quarter & 1 ? c : s;
    *cosine = quarter & 1 ? s : c;
    if (quarter & 2)
        *sine = -*sine;
    if ((quarter + 1) & 2)
        *cosine = -*cosine;
}

double vs_decay(double exponent)
{
    double halvings, rest, sum = 1.0 / 6227020800.0;
    uint64_t bits;
    double scale;
    int i;

    if (!(exponent <= 0.0))
        return 1.0;
    if (exponent < LEAST_EXPONENT)
        return 0.0;
    halvings = (double)nearest(exponent * PER_DOUBLING);
    rest = (exponent - halvings * DOUBLING_1) - halvings * DOUBLING_2;
    for (i = 12; i >= 0; i--)
        sum = sum * rest + inverse_factorial[i];
    bits = (uint64_t)((int64_t)halvings + 1023) << 52;
    memcpy(&scale, &bits, sizeof scale);
    return sum * scale;
}

/* arctan of t in [0, 1]: from the nearest of the known angles on it is Taylor's series, whose first
 * term left out is below 1e-18. */
static double arctan_of_slope(double t)
{
    int nearest_known = (int)(8.0 * t + 0.5);
    double known = 0.125 * nearest_known;
    double rest = (t - known) / (1.0 + t * known);
    double xx = rest * rest;
    double sum = -1.0 / 15.0;

    sum = sum * xx + 1.0 / 13.0;
    sum = sum * xx - 1.0 / 11.0;
    sum = sum * xx + 1.0 / 9.0;
    sum = sum * xx - 1.0 / 7.0;
    sum = sum * xx + 1.0 / 5.0;
    sum = sum * xx - 1.0 / 3.0;
    return arctan_of_eighths[nearest_known] + (rest + rest * xx * sum);
}

double vs_bearing(double y, double x)
{
    double high = fabs(y), wide = fabs(x);
    double angle;

    if (high == 0.0 && wide == 0.0)
        return 0.0;
    if (high <= wide)
        angle = arctan_of_slope(high / wide);
    else
        angle = 0.5 * VS_PI - arctan_of_slope(wide / high);
    if (x < 0.0)
        angle = VS_PI - angle;
    return y < 0.0 ? -angle : angle;
}

double vs_wrap_angle(double angle_rad)
{
    double wrapped = angle_rad;

    if (angle_rad > VS_PI || angle_rad <= -VS_PI)
        wrapped -= (double)nearest(angle_rad / (2.0 * VS_PI)) * (2.0 * VS_PI);
    if (wrapped > VS_PI)
        return wrapped - 2.0 * VS_PI;
    return wrapped > -VS_PI ? wrapped : wrapped + 2.0 * VS_PI;
}
