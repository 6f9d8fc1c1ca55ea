/* SPDX-License-Identifier: MIT */
#include "vs_hearing_noise.h"

#include <stddef.h>

#include "vs_libm.h"
#include "vs_math.h"

#define POINTS 9

/* What the real board measures at a distance: power, log-normal; and exp(a + b power) is the
 * distance [cm] that it tells. Source: argos3-epuck 66cb8d9,
 * epuck_range_and_bearing_default_sensor.cpp lines 33-34 and 78-96. */
static const double real_cm[POINTS] = {0.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 60.0, 80.0};
static const double real_mu[POINTS] = {7.64689,  7.596525, 7.24955,  7.084636, 6.984497,
                                       6.917447, 6.823188, 6.828551, 6.828551};
static const double real_sigma[POINTS] = {0.3570609, 0.319231,  0.1926492, 0.1529397, 0.109233,
                                          0.1216533, 0.1531546, 0.1418425, 0.1418425};
static const double power_a = 9.06422181283387, power_b = -0.00565074879677167;

static void go_away(const struct vs_hearing *how, struct vs_noticed *one, double normal)
{
    one->key = how->noise_m * normal;
}

/* Leaves what of it is along the floor, and what is upright. */
static void incline(const struct vs_hearing *how, struct vs_noticed *one, double uniform)
{
    double cosine, sine, away_m = one->key;

    (void)how;
    vs_libm_direction(VS_PI * uniform, &cosine, &sine);
    one->key = away_m * sine;
    one->drawn = away_m * cosine;
}

static void turn(const struct vs_hearing *how, struct vs_noticed *one, double uniform)
{
    double to[2], of[2], ahead_m, left_m;

    (void)how;
    vs_libm_direction(one->bearing_rad, &of[0], &of[1]);
    vs_libm_direction(2.0 * VS_PI * uniform, &to[0], &to[1]);
    ahead_m = one->distance_m * of[0] + one->key * to[0];
    left_m = one->distance_m * of[1] + one->key * to[1];
    one->distance_m = vs_libm_root(ahead_m * ahead_m + left_m * left_m + one->drawn * one->drawn);
    one->bearing_rad = vs_libm_bearing(left_m, ahead_m);
}

/* numpy.interp */
static double between(const double *values, double x)
{
    uint32_t k = 0;

    if (x < real_cm[0])
        return values[0];
    if (x >= real_cm[POINTS - 1])
        return values[POINTS - 1];
    while (x >= real_cm[k + 1])
        k++;
    return (values[k + 1] - values[k]) / (real_cm[k + 1] - real_cm[k]) * (x - real_cm[k]) +
           values[k];
}

static void measure_really(const struct vs_hearing *how, struct vs_noticed *one, double normal)
{
    double mu = between(real_mu, one->distance_m), sigma = between(real_sigma, one->distance_m);

    (void)how;
    one->distance_m = vs_libm_exp(power_a + power_b * vs_libm_exp(mu + sigma * normal));
}

static void tell_range(const struct vs_hearing *how, struct vs_noticed *one, double drawn)
{
    double range_m = one->distance_m - 2.0 * how->body_m;

    (void)drawn;
    one->distance_m = 100.0 * (how->shuffled ? range_m : vs_most(range_m, 0.0));
}

/* Does something with every message, robot by robot, and with a number that is drawn for it. */
static void each(const struct vs_hearing *how, uint32_t robots,
                 void (*does)(const struct vs_hearing *how, struct vs_noticed *one, double drawn),
                 double (*draw)(void *whose), void *whose)
{
    uint32_t i, k;

    for (i = 0; i < robots; i++)
        for (k = 0; k < how->counts[i]; k++)
            does(how, how->heard + (size_t)i * how->most + k, draw ? draw(whose) : 0.0);
}

void vs_hearing_disturb(const struct vs_hearing *how, uint32_t robots)
{
    const struct vs_random *random = how->random;

    if (how->noise_m > 0.0) {
        each(how, robots, go_away, random->standard_normal, random->bits);
        each(how, robots, incline, random->next_double, random->state);
        each(how, robots, turn, random->next_double, random->state);
    }
    each(how, robots, tell_range, NULL, NULL);
    if (how->real_range)
        each(how, robots, measure_really, random->standard_normal, random->bits);
}
