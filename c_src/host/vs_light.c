/* SPDX-License-Identifier: MIT */
#include "vs_light.h"

#include <math.h>
#include <string.h>

#include "vs_math.h"
#include "vs_place.h"

#define CENTRE_REACH 2.5 /* ARGoS's epuck_light ends at this distance over intensity */

/* What a light gives at the robot's centre if nothing stands in the way. */
static double received(const struct vs_light_ring *ring, const struct vs_light *light,
                       const double way_m[3])
{
    double distance_m =
        vs_root(way_m[0] * way_m[0] + way_m[1] * way_m[1] + way_m[2] * way_m[2]);

    if (distance_m > CENTRE_REACH * light->intensity || distance_m > ring->range_m)
        return 0.0;
    return vs_decay(-2.0 * (distance_m / light->intensity));
}

/* Adds what each sensor gets of a light in this direction. */
static void share_out(const struct vs_light_ring *ring, double bearing_rad, double light,
                      double *sums)
{
    double half_view_rad = 0.5 * ring->view_rad;
    uint32_t k;

    for (k = 0; k < ring->sensors; k++) {
        double turn_rad = fabs(bearing_rad - ring->angles_rad[k]);
        double off_rad = vs_least(turn_rad, 2.0 * VS_PI - turn_rad);
        double share = vs_most(1.0 - 2.0 / VS_PI * off_rad, 0.0);

        sums[k] += off_rad <= half_view_rad ? light * share : 0.0;
    }
}

static int read_at_centre(const struct vs_light_ring *ring, const struct vs_scene *scene,
                          const struct vs_place *place, int32_t own, double *sums)
{
    double centre_m[3] = {place->x_m, place->y_m, 0.0};
    uint32_t l;

    for (l = 0; l < scene->lights_count; l++) {
        const struct vs_light *light = &scene->lights[l];
        double way_m[3] = {light->at_m[0] - centre_m[0], light->at_m[1] - centre_m[1],
                           light->at_m[2]};
        double bright = received(ring, light, way_m);
        uint8_t blocked = 0;

        if (bright == 0.0)
            continue;
        if (ring->occlusions && vs_rays_blocked(scene->obstacles, centre_m, light->at_m, 1, &own,
                                                1, &blocked) != VS_OK)
            return VS_ERR_ARGUMENT;
        if (!blocked)
            share_out(ring, vs_wrap_angle(vs_bearing(way_m[1], way_m[0]) - place->yaw_rad),
                      bright, sums);
    }
    return VS_OK;
}

/* Where the sensors of a robot are, three coordinates each. */
static void find_sensors(const struct vs_light_ring *ring, const struct vs_place *place,
                         double *points_m)
{
    uint32_t k;

    for (k = 0; k < ring->sensors; k++) {
        double *point_m = points_m + 3 * k;
        double sine, cosine;

        vs_sin_cos(place->yaw_rad + ring->angles_rad[k], &sine, &cosine);
        point_m[0] = place->x_m + ring->radius_m * cosine;
        point_m[1] = place->y_m + ring->radius_m * sine;
        point_m[2] = ring->height_m;
    }
}

/* (intensity / distance)^2 of a light at a sensor that looks to heading_rad. */
static double at_sensor(const struct vs_light_ring *ring, const struct vs_light *light,
                        const double *point_m, double heading_rad)
{
    double east_m = light->at_m[0] - point_m[0];
    double north_m = light->at_m[1] - point_m[1];
    double up_m = light->at_m[2] - point_m[2];
    double squared = east_m * east_m + north_m * north_m + up_m * up_m;
    double least = ring->nearest_m * ring->nearest_m;

    if (squared > ring->range_m * ring->range_m)
        return 0.0;
    if (ring->view_rad < 2.0 * VS_PI &&
        fabs(vs_wrap_angle(vs_bearing(north_m, east_m) - heading_rad)) > 0.5 * ring->view_rad)
        return 0.0;
    return light->intensity * light->intensity / vs_most(squared, least);
}

static int read_at_sensors(const struct vs_light_ring *ring, const struct vs_scene *scene,
                           const struct vs_place *place, double *sums)
{
    static const int32_t nobody[VS_LIGHT_SENSORS_MAX];
    double points_m[3 * VS_LIGHT_SENSORS_MAX];
    uint8_t seen[VS_LIGHT_SENSORS_MAX];
    uint32_t k, l;

    find_sensors(ring, place, points_m);
    for (l = 0; l < scene->lights_count; l++) {
        const struct vs_light *light = &scene->lights[l];

        memset(seen, 1, sizeof seen);
        if (ring->occlusions && vs_sight_seen(scene->obstacles, points_m, ring->sensors,
                                              light->at_m, 1, nobody, 0, seen) != VS_OK)
            return VS_ERR_ARGUMENT;
        for (k = 0; k < ring->sensors; k++)
            if (seen[k])
                sums[k] += at_sensor(ring, light, points_m + 3 * k,
                                     place->yaw_rad + ring->angles_rad[k]);
    }
    return VS_OK;
}

int vs_light_read(const void *light_ring, const struct vs_scene *scene, double *readings)
{
    const struct vs_light_ring *ring = light_ring;
    uint32_t i, k;

    if (ring->sensors > VS_LIGHT_SENSORS_MAX)
        return VS_ERR_ARGUMENT;
    for (i = 0; i < scene->robots; i++) {
        struct vs_place place = vs_place_of(scene, i);
        double *sums = readings + i * ring->step;
        int err;

        for (k = 0; k < ring->sensors; k++)
            sums[k] = 0.0;
        if (ring->formula == VS_LIGHT_AT_CENTRE)
            err = read_at_centre(ring, scene, &place, scene->own[i], sums);
        else
            err = read_at_sensors(ring, scene, &place, sums);
        if (err != VS_OK)
            return err;
        for (k = 0; k < ring->sensors; k++)
            sums[k] = vs_least(sums[k], ring->most) * ring->gain;
    }
    return VS_OK;
}
