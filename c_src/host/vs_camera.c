/* SPDX-License-Identifier: MIT */
#include "vs_camera.h"

#include <math.h>
#include <string.h>

#include "vs_libm.h"
#include "vs_math.h"
#include "vs_place.h"

#define WIDTH 5         /* numbers of an LED */
#define DIAGONAL 1.4143 /* of a square, over its side: a little more than it is */
#define FULL 255

int vs_lamps_light(const void *lamps, const struct vs_scene *scene, const double *levels,
                   const double *growth)
{
    const struct vs_lamps *how = lamps;
    uint32_t i, k, c;

    (void)scene;
    (void)growth;
    for (i = 0; i < how->robots; i++) {
        uint8_t *colors = how->colors + 3 * (size_t)how->leds * (size_t)how->rows[i];
        uint8_t *own = colors + 3 * how->first, *shown = how->shown + 3 * how->rows[i];

        for (k = 0; k < how->count && how->switches; k++, own += 3) {
            own[0] = levels[how->count - 1 - k] > 0.0 ? FULL : 0;
            own[1] = own[2] = 0;
        }
        for (k = 0; k < 3 * how->count && !how->switches; k++)
            own[k] = (uint8_t)levels[k];
        levels += how->switches ? how->count : 3 * how->count;
        memset(shown, 0, 3);
        for (k = 0; k < how->leds; k++)
            for (c = 0; c < 3; c++)
                shown[c] = colors[3 * k + c] > shown[c] ? colors[3 * k + c] : shown[c];
    }
    return VS_OK;
}

static int is_lit(const uint8_t *color)
{
    return (color[0] | color[1] | color[2]) != 0;
}

/* Adds the lit LEDs of a robot that stands there; gives how many there are. */
static uint32_t add_robot(const struct vs_camera *how, uint32_t robot, const double place[3],
                          struct vs_lit *lit)
{
    const uint8_t *colors = how->colors + 3 * (size_t)how->leds * robot;
    uint32_t count = 0, k;
    double cosine, sine;

    vs_libm_direction(place[2], &cosine, &sine);
    for (k = 0; k < how->leds; k++) {
        const double *led_m = how->leds_m + 3 * ((size_t)how->leds * robot + k);

        if (!is_lit(colors + 3 * k))
            continue;
        lit[count].at_m[0] = place[0] + led_m[0] * cosine - led_m[1] * sine;
        lit[count].at_m[1] = place[1] + led_m[0] * sine + led_m[1] * cosine;
        lit[count].at_m[2] = led_m[2];
        lit[count].robot = (int32_t)robot;
        lit[count++].color = colors + 3 * k;
    }
    for (k = 0; k < count; k++)
        lit[k].together = count - k;
    return count;
}

/* Finds all LEDs of robots that are lit, and gives how many there are: they follow those of
 * things. */
static uint32_t gather(const struct vs_camera *how)
{
    const struct vs_pose_fields *fields = how->world->fields;
    struct vs_lit *lit = how->lit + how->still;
    uint32_t count = 0, j;

    for (j = 0; j < how->world->robots_all; j++) {
        const uint8_t *row = how->world->robots + (size_t)j * fields->row;
        double place[3];
        int64_t capture_ns;

        memcpy(place, row + fields->place, sizeof place);
        memcpy(&capture_ns, row + fields->capture, sizeof capture_ns);
        if (capture_ns >= 0)
            count += add_robot(how, j, place, lit + count);
    }
    return count;
}

/* Whether a camera sees an LED on its way, if nothing is between. */
static int is_near(const struct vs_camera *how, const double way_m[3])
{
    if (!(way_m[2] < how->height_m))
        return 0;
    if (how->square)
        return fabs(way_m[0]) < how->reach_m && fabs(way_m[1]) < how->reach_m;
    return way_m[0] * way_m[0] + way_m[1] * way_m[1] + way_m[2] * way_m[2] < how->reach2_m2;
}

/* What a camera looks at: LEDs of robots, or of things. */
struct view {
    const struct vs_obstacles *obstacles;
    double at_m[3];
    int32_t own;
    struct vs_noticed *seen;
    uint32_t count;
    uint32_t room;
};

/* Adds what is seen of some LEDs, from number `first` on: the way to it, along x and y. */
static int look(const struct vs_camera *how, struct view *view, uint32_t first, uint32_t count)
{
    double far_m = DIAGONAL * how->reach_m + how->apart_m;
    uint32_t l;

    for (l = first; l < first + count; l++) {
        const struct vs_lit *lit = &how->lit[l];
        double way_m[3] = {lit->at_m[0] - view->at_m[0], lit->at_m[1] - view->at_m[1],
                           lit->at_m[2] - view->at_m[2]};
        struct vs_noticed one = {l, 0.0, way_m[0], way_m[1], 0.0};
        uint8_t blocked;

        if (way_m[0] * way_m[0] + way_m[1] * way_m[1] > far_m * far_m ||
            (lit->robot >= 0 && lit->robot == view->own)) {
            l += lit->together - 1;
            continue;
        }
        if (!is_near(how, way_m))
            continue;
        if (vs_rays_blocked(view->obstacles, view->at_m, lit->at_m, 1, &view->own, 1, &blocked) !=
            VS_OK)
            return VS_ERR_ARGUMENT;
        if (!blocked && view->count == view->room)
            return VS_ERR_SPACE;
        if (!blocked)
            view->seen[view->count++] = one;
    }
    return VS_OK;
}

/* Shifts all that is seen along the floor: first lengths are drawn, then directions. */
static void disturb(const struct vs_camera *how, struct vs_noticed *seen, uint32_t count)
{
    const struct vs_random *random = how->random;
    double cosine, sine;
    uint32_t k;

    for (k = 0; k < count; k++) {
        seen[k].drawn = how->noise * random->standard_normal(random->bits);
        if (how->square)
            seen[k].drawn *= vs_libm_distance(seen[k].distance_m, seen[k].bearing_rad);
    }
    for (k = 0; k < count; k++) {
        vs_libm_direction(2.0 * VS_PI * random->next_double(random->state), &cosine, &sine);
        seen[k].distance_m += seen[k].drawn * cosine;
        seen[k].bearing_rad += seen[k].drawn * sine;
    }
}

/* Writes the nearest of what a robot sees, whose ways become distances and bearings. */
static void write(const struct vs_camera *how, const struct vs_noticed *seen, uint32_t count,
                  double yaw_rad, double *reading)
{
    uint32_t kept = 0, k, c;

    for (k = 0; k < 1 + WIDTH * how->most; k++)
        reading[k] = 0.0;
    for (k = 0; k < count; k++) {
        double x_m = seen[k].distance_m, y_m = seen[k].bearing_rad;
        struct vs_noticed one = {seen[k].who, vs_libm_distance(x_m, y_m), 0.0, 0.0, 0.0};

        one.bearing_rad = vs_libm_wrap(vs_libm_bearing(y_m, x_m) - yaw_rad);
        kept = vs_notice(how->nearest, kept, how->most, &one);
    }
    *reading++ = kept;
    for (k = 0; k < kept; k++, reading += WIDTH) {
        reading[0] = 100.0 * how->nearest[k].key;
        reading[1] = how->nearest[k].bearing_rad;
        for (c = 0; c < 3; c++)
            reading[2 + c] = how->lit[how->nearest[k].who].color[c];
    }
}

/* All that a robot's camera sees, behind what is seen so far. */
static int watch(const struct vs_camera *how, const struct vs_scene *scene, uint32_t i,
                 uint32_t lit, uint32_t so_far)
{
    struct vs_place place = vs_place_of(scene, i);
    struct view view = {scene->obstacles, {place.x_m, place.y_m, how->height_m}, scene->own[i],
                        how->seen + so_far, 0, how->room - so_far};
    int err = look(how, &view, how->still, lit);

    if (err == VS_OK)
        err = look(how, &view, 0, how->still);
    how->counts[i] = view.count;
    return err;
}

int vs_camera_read(const void *camera, const struct vs_scene *scene, double *readings)
{
    const struct vs_camera *how = camera;
    uint32_t lit = gather(how), seen = 0, i;
    size_t width = 1 + WIDTH * (size_t)how->most;
    int is_noisy = how->noise > 0.0;

    for (i = 0; i < scene->robots; i++) {
        int err = watch(how, scene, i, lit, seen);

        if (err != VS_OK)
            return err;
        if (is_noisy)
            seen += how->counts[i];
        else
            write(how, how->seen, how->counts[i], vs_place_of(scene, i).yaw_rad,
                  readings + i * width);
    }
    if (!is_noisy)
        return VS_OK;
    disturb(how, how->seen, seen);
    for (i = seen = 0; i < scene->robots; seen += how->counts[i++])
        write(how, how->seen + seen, how->counts[i], vs_place_of(scene, i).yaw_rad,
              readings + i * width);
    return VS_OK;
}
