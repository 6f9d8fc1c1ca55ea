/* SPDX-License-Identifier: MIT */
#include "vs_leds.h"

#include <math.h>

#include "vs_math.h"
#include "vs_place.h"

#define WIDTH 5 /* numbers of a light */

struct blob {
    uint32_t robot;
    double distance_m;
    double bearing_rad;
};

int vs_shine_show(const void *shine, const struct vs_scene *scene, const double *levels,
                  const double *growth)
{
    const struct vs_shine *how = shine;
    uint32_t i, c;

    (void)scene;
    (void)growth;
    for (i = 0; i < how->robots; i++)
        for (c = 0; c < 3; c++)
            how->colors[3 * how->rows[i] + (int32_t)c] = (uint8_t)levels[3 * i + c];
    return VS_OK;
}

/* Whether a robot shines and has been seen, and where. */
static int shines(const struct vs_leds *leds, uint32_t robot, struct vs_place *place)
{
    const struct vs_pose_fields *fields = leds->world->fields;
    const uint8_t *row = leds->world->robots + (size_t)robot * fields->row;
    const uint8_t *color = leds->colors + 3 * (size_t)robot;
    int64_t capture_ns;

    memcpy(place, row + fields->place, sizeof *place);
    memcpy(&capture_ns, row + fields->capture, sizeof capture_ns);
    return (color[0] | color[1] | color[2]) != 0 && capture_ns >= 0;
}

/* 1 if nothing stands between two robots, 0 if something does, or an error. */
static int is_free(const struct vs_leds *leds, const struct vs_scene *scene,
                   const struct vs_place *from, const struct vs_place *to, const int32_t both[2])
{
    double start_m[3] = {from->x_m, from->y_m, leds->height_m};
    double end_m[3] = {to->x_m, to->y_m, leds->height_m};
    uint8_t blocked = 0;
    int err = VS_OK;

    if (leds->occlusions)
        err = vs_rays_blocked(scene->obstacles, start_m, end_m, 1, both, 2, &blocked);
    return err == VS_OK ? !blocked : err;
}

/* Puts a light where it belongs among the nearest ones; of two as far away the first stays it. */
static uint32_t insert(struct blob *blobs, uint32_t count, uint32_t most, const struct blob *one)
{
    uint32_t at = count < most ? count : most - 1;

    for (; at > 0 && blobs[at - 1].distance_m > one->distance_m; at--)
        blobs[at] = blobs[at - 1];
    blobs[at] = *one;
    return count < most ? count + 1 : most;
}

/* The lights that a robot sees, or an error. */
static int look(const struct vs_leds *leds, const struct vs_scene *scene, uint32_t robot,
                struct blob *blobs)
{
    struct vs_place from = vs_place_of(scene, robot), to;
    uint32_t count = 0, j;

    for (j = 0; j < leds->world->robots_all; j++) {
        int32_t both[2] = {scene->own[robot], (int32_t)j};
        double east_m, north_m, squared;
        struct blob one;
        int is_seen;

        if (both[0] == both[1] || !shines(leds, j, &to))
            continue;
        east_m = to.x_m - from.x_m;
        north_m = to.y_m - from.y_m;
        squared = east_m * east_m + north_m * north_m;
        if (!(squared < leds->range_m * leds->range_m))
            continue;
        one.robot = j;
        one.distance_m = vs_root(squared);
        one.bearing_rad = vs_wrap_angle(vs_bearing(north_m, east_m) - from.yaw_rad);
        if (!(fabs(one.bearing_rad) <= 0.5 * leds->view_rad) ||
            (count == leds->most && one.distance_m >= blobs[count - 1].distance_m))
            continue;
        is_seen = is_free(leds, scene, &from, &to, both);
        if (is_seen < 0)
            return is_seen;
        if (is_seen)
            count = insert(blobs, count, leds->most, &one);
    }
    return (int)count;
}

int vs_leds_read(const void *leds, const struct vs_scene *scene, double *readings)
{
    const struct vs_leds *how = leds;
    size_t width = 1 + WIDTH * (size_t)how->most, i;
    struct blob blobs[VS_LEDS_MOST];

    if (how->most < 1 || how->most > VS_LEDS_MOST)
        return VS_ERR_ARGUMENT;
    for (i = 0; i < scene->robots * width; i++)
        readings[i] = 0.0;
    for (i = 0; i < scene->robots; i++) {
        int count = look(how, scene, (uint32_t)i, blobs), k;
        double *to = readings + i * width;

        if (count < 0)
            return count;
        *to++ = count;
        for (k = 0; k < count; k++, to += WIDTH) {
            const uint8_t *color = how->colors + 3 * (size_t)blobs[k].robot;

            to[0] = 100.0 * blobs[k].distance_m;
            to[1] = blobs[k].bearing_rad;
            to[2] = color[0];
            to[3] = color[1];
            to[4] = color[2];
        }
    }
    return VS_OK;
}
