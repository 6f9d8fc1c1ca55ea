/* SPDX-License-Identifier: MIT */
#include "vs_proximity.h"

#include <math.h>

#include "vs_libm.h"
#include "vs_line.h"
#include "vs_math.h"
#include "vs_place.h"

#define CURVE_ENDS_M 0.05 /* the curve holds up to here, and is 0 beyond */
#define SLACK_M 1e-6      /* more than rounding moves the end of a line by */

/* ARGoS's curve, in [0, 1]. Source: argos3-epuck 66cb8d9, epuck_proximity_default_sensor.cpp */
static double respond(double distance_m)
{
    double curve = 298.701 * (distance_m * distance_m) - 36.8961 * distance_m + 1.08212;

    if (!(distance_m <= CURVE_ENDS_M))
        return 0.0;
    return vs_least(vs_most(curve, 0.0), 1.0);
}

/* Source: argos3 421bd76, footbot_proximity_default_sensor.cpp */
static double respond_as_foot_bot(double distance_m)
{
    return distance_m < 0.009889556 ? 1.0 : 0.0100527 / (distance_m + 0.000163144);
}

/* Source: argos3-kheperaiv 235eaa1, kheperaiv_proximity_default_sensor.cpp */
static double respond_as_khepera(double distance_m)
{
    double curve = 4.14 * vs_libm_exp(-33.0 * distance_m) - 0.085;

    if (distance_m < 0.04)
        return 1.0;
    return distance_m > 0.12 ? 0.0 : vs_least(vs_most(curve, 0.0), 1.0);
}

/* What a ring reads at a distance, which is infinite where nothing is. */
static double reading_at(const struct vs_proximity_ring *ring, double distance_m)
{
    switch (ring->curve) {
    case VS_CURVE_GENERIC:
        return vs_libm_exp(-distance_m);
    case VS_CURVE_FOOTBOT:
        return respond_as_foot_bot(distance_m);
    case VS_CURVE_DISTANCE:
        return distance_m < INFINITY ? distance_m : ring->range_m;
    case VS_CURVE_KHEPERA:
        return respond_as_khepera(distance_m);
    default:
        return respond(distance_m * ring->share);
    }
}

/* The bodies that a ring senses, and which of them is passed over. */
struct sensed {
    const struct vs_obstacles *bodies;
    int32_t skip;
};

/* How far the first body on a sensor's lines is, infinity: there is none; or an error. */
static int look(const struct vs_proximity_ring *ring, const struct sensed *sensed,
                const struct vs_place *place, double heading_rad, double *distance_m)
{
    double start_m[3], end_m[3], way[2], share, least = INFINITY;
    uint32_t r;

    vs_libm_direction(heading_rad, &way[0], &way[1]);
    start_m[0] = place->x_m + ring->radius_m * way[0];
    start_m[1] = place->y_m + ring->radius_m * way[1];
    start_m[2] = end_m[2] = ring->height_m;
    for (r = 0; r < ring->rays; r++) {
        if (ring->rays > 1)
            vs_libm_direction(heading_rad + ring->fan_rad[r], &way[0], &way[1]);
        end_m[0] = start_m[0] + ring->range_m * way[0];
        end_m[1] = start_m[1] + ring->range_m * way[1];
        if (vs_rays_nearest(sensed->bodies, start_m, end_m, 1, &sensed->skip, 1, &share) != VS_OK)
            return VS_ERR_ARGUMENT;
        if (!ring->blind_within || share > 0.0)
            least = vs_least(least, share);
    }
    *distance_m = ring->range_m * least;
    return VS_OK;
}

/* How far the line of a sensor that has one of its own is free; or an error. */
static int look_along(const struct vs_proximity_ring *ring, const struct sensed *sensed,
                      const struct vs_place *place, const double line_m[4], double *distance_m)
{
    double ends_m[2][3], cosine, sine, share;
    uint32_t i;

    vs_libm_direction(place->yaw_rad, &cosine, &sine);
    for (i = 0; i < 2; i++, line_m += 2) {
        ends_m[i][0] = place->x_m + line_m[0] * cosine - line_m[1] * sine;
        ends_m[i][1] = place->y_m + line_m[0] * sine + line_m[1] * cosine;
        ends_m[i][2] = ring->height_m;
    }
    if (vs_rays_nearest(sensed->bodies, ends_m[0], ends_m[1], 1, &sensed->skip, 1, &share) != VS_OK)
        return VS_ERR_ARGUMENT;
    *distance_m = share * vs_libm_distance(ends_m[1][0] - ends_m[0][0], ends_m[1][1] - ends_m[0][1]);
    if (ring->blind_within && share == 0.0)
        *distance_m = INFINITY;
    return VS_OK;
}

static int read_ring(const struct vs_proximity_ring *ring, const struct sensed *sensed,
                     const struct vs_place *place, double *readings)
{
    uint32_t k;

    for (k = 0; k < ring->sensors; k++) {
        double distance_m;
        int err;

        if (ring->lines_m)
            err = look_along(ring, sensed, place, ring->lines_m + 4 * k, &distance_m);
        else
            err = look(ring, sensed, place, place->yaw_rad + ring->places_rad[k],
                       &distance_m);
        if (err != VS_OK)
            return err;
        readings[k] = ring->full * reading_at(ring, distance_m);
    }
    return VS_OK;
}

int vs_proximity_read(const void *proximity_ring, const struct vs_scene *scene, double *readings)
{
    const struct vs_proximity_ring *ring = proximity_ring;
    double reach_m = ring->radius_m + ring->range_m + SLACK_M;
    struct sensed sensed = {ring->bodies, -1};
    uint32_t i, k;

    for (i = 0; i < scene->robots; i++, readings += ring->sensors) {
        struct vs_place place = vs_place_of(scene, i);
        int is_near;

        if (!ring->bodies) {
            sensed.bodies = scene->obstacles;
            sensed.skip = scene->own[i];
        }
        is_near = vs_line_near(sensed.bodies, place.x_m, place.y_m, reach_m, sensed.skip);
        if (is_near < 0 || (is_near && read_ring(ring, &sensed, &place, readings) != VS_OK))
            return VS_ERR_ARGUMENT;
        for (k = 0; k < ring->sensors && !is_near; k++)
            readings[k] = ring->full * reading_at(ring, INFINITY);
    }
    return VS_OK;
}
