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

/* The bodies that a ring senses, and which of them is passed over. */
struct sensed {
    const struct vs_obstacles *bodies;
    int32_t skip;
};

/* The least share of a sensor's lines that is free, infinity: all of it; or an error. */
static int look(const struct vs_proximity_ring *ring, const struct sensed *sensed,
                const struct vs_place *place, double heading_rad, double *least)
{
    double start_m[3], end_m[3], way[2], share;
    uint32_t r;

    *least = INFINITY;
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
            *least = vs_least(*least, share);
    }
    return VS_OK;
}

static int read_ring(const struct vs_proximity_ring *ring, const struct sensed *sensed,
                     const struct vs_place *place, double *readings)
{
    uint32_t k;

    for (k = 0; k < ring->sensors; k++) {
        double least, distance_m;

        if (look(ring, sensed, place, place->yaw_rad + ring->places_rad[k], &least) != VS_OK)
            return VS_ERR_ARGUMENT;
        distance_m = ring->range_m * least;
        readings[k] = ring->full * (ring->generic ? vs_libm_exp(-distance_m)
                                                  : respond(distance_m * ring->share));
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
            readings[k] = 0.0;
    }
    return VS_OK;
}
