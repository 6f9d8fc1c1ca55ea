/* SPDX-License-Identifier: MIT */
#include "vs_floor.h"

#include <math.h>

#include "../vs_err.h"
#include "vs_libm.h"
#include "vs_math.h"
#include "vs_place.h"

static int lies_in(const struct vs_zone *zone, const double *point_m)
{
    double x = point_m[0] - zone->x_m, y = point_m[1] - zone->y_m;

    if (zone->radius_m2 >= 0.0)
        return x * x + y * y <= zone->radius_m2;
    return fabs(x * zone->cosine + y * zone->sine) <= zone->half_m[0] &&
           fabs(y * zone->cosine - x * zone->sine) <= zone->half_m[1];
}

void vs_zone_contains(const struct vs_zone *zone, const double *points_m, uint32_t n,
                      uint8_t *inside)
{
    uint32_t i;

    for (i = 0; i < n; i++)
        inside[i] = (uint8_t)lies_in(zone, points_m + 2 * i);
}

/* Along one axis: the pixel that a place lies in, or the nearest one. */
static size_t pixel(const struct vs_floor *floor, const double *point_m, uint32_t axis,
                    uint32_t pixels)
{
    double from_edge_m = point_m[axis] - floor->centre_m[axis] + 0.5 * floor->size_m[axis];
    double place = from_edge_m * (pixels / floor->size_m[axis]);

    return (size_t)vs_least(place > 0.0 ? place : 0.0, pixels - 1.0);
}

static void give(double *color, const uint8_t *from, uint32_t channels)
{
    uint32_t c;

    for (c = 0; c < channels; c++)
        color[c] = from[c];
}

/* What lies under the zones. */
static void take_pixel(const struct vs_floor *floor, const double *point_m, double *color)
{
    give(color, floor->color, 4);
    if (floor->image) {
        size_t column = pixel(floor, point_m, 0, floor->columns);
        size_t row = floor->rows - 1 - pixel(floor, point_m, 1, floor->rows);

        give(color, floor->image + (row * floor->columns + column) * floor->channels,
             floor->channels);
    }
}

int vs_floor_sample(const struct vs_floor *floor, const double *points_m, uint32_t n,
                    double *colors)
{
    int err = floor->ask ? floor->ask(floor->whom, points_m, n, colors) : VS_OK;
    uint32_t i, z;

    for (i = 0; i < n && err == VS_OK; i++) {
        const double *point_m = points_m + 2 * (size_t)i;
        double *color = colors + 4 * (size_t)i;

        if (!floor->ask)
            take_pixel(floor, point_m, color);
        for (z = 0; z < floor->zones_count; z++)
            if (lies_in(&floor->zones[z], point_m))
                give(color, floor->zones[z].color, 4);
    }
    return err;
}

/* Where a robot looks. */
static void aim(const struct vs_ground *ground, const struct vs_place *place, double *points_m)
{
    double cosine, sine;
    uint32_t k;

    vs_libm_direction(place->yaw_rad, &cosine, &sine);
    for (k = 0; k < ground->points; k++) {
        double ahead_m = ground->ahead_m[k], left_m = ground->left_m[k];

        points_m[2 * k] = place->x_m + ahead_m * cosine - left_m * sine;
        points_m[2 * k + 1] = place->y_m + ahead_m * sine + left_m * cosine;
    }
}

int vs_ground_read(const void *ground, const struct vs_scene *scene, double *readings)
{
    const struct vs_ground *how = ground;
    uint32_t count = scene->robots * how->points, i;
    double *colors = how->grey ? how->colors : readings;
    int err;

    for (i = 0; i < scene->robots; i++) {
        struct vs_place place = vs_place_of(scene, i);

        aim(how, &place, how->points_m + 2 * (size_t)(i * how->points));
    }
    err = vs_floor_sample(how->floor, how->points_m, count, colors);
    for (i = 0; i < count && how->grey && err == VS_OK; i++) {
        const double *color = colors + 4 * (size_t)i;
        double sum = color[0] * how->grey[0] + color[1] * how->grey[1] + color[2] * how->grey[2];

        readings[i] = vs_least(vs_most(sum, 0.0), 1.0);
    }
    return err;
}
