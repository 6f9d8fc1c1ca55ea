/* SPDX-License-Identifier: MIT */
#include "vs_hearing.h"

#include <math.h>
#include <string.h>

#include "vs_hearing_noise.h"
#include "vs_libm.h"
#include "vs_math.h"
#include "vs_place.h"

#define NO_KEY 0.0

enum { UNKNOWN, FREE, CUT };

int vs_speech_set(const void *speech, const struct vs_scene *scene, const double *levels,
                  const double *growth)
{
    const struct vs_speech *how = speech;
    uint32_t i, k;

    (void)scene;
    (void)growth;
    for (i = 0; i < how->robots; i++, levels += 1 + how->size) {
        struct vs_message *message = &how->messages[how->rows[i]];

        memset(message->data, 0, sizeof message->data);
        message->length = (uint8_t)levels[0];
        message->range_m = how->range_m;
        for (k = 0; k < how->size && k < message->length; k++)
            message->data[k] = (uint8_t)levels[1 + k];
    }
    return VS_OK;
}

/* Notes where all robots are and how far each is heard, squared; less than 0: it is not. */
static void gather(const struct vs_hearing *how)
{
    const struct vs_pose_fields *fields = how->world->fields;
    size_t all = how->world->robots_all;
    uint32_t j;

    if (how->lines)
        memset(how->lines, UNKNOWN, all * all);
    for (j = 0; j < all; j++) {
        const uint8_t *row = how->world->robots + (size_t)j * fields->row;
        const struct vs_message *message = &how->messages[j];
        double reach_m = message->range_m > 0.0 ? message->range_m : how->range_m;
        double *place = how->places_m + 3 * (size_t)j;
        int64_t capture_ns;

        memcpy(place, row + fields->place, 2 * sizeof *place);
        memcpy(&capture_ns, row + fields->capture, sizeof capture_ns);
        place[2] = reach_m * reach_m;
        if (capture_ns < 0 || (how->speaking && message->length == 0))
            place[2] = -1.0;
    }
}

/* Where it is noted whether the line between two robots is free; NULL: nowhere, as this one's own
 * place is not where others hear it. */
static uint8_t *note_of(const struct vs_hearing *how, const double own_m[3], int32_t own,
                        uint32_t who)
{
    size_t all = how->world->robots_all, one = (size_t)own;
    const double *place = how->places_m;

    if (!how->lines || own < 0 || one >= all)
        return NULL;
    place += 3 * one;
    if (place[0] != own_m[0] || place[1] != own_m[1])
        return NULL;
    return how->lines + (one < who ? one * all + who : who * all + one);
}

/* Whether something stands between a robot and another one: 1 or 0, or an error. Both ways are one
 * line, from the first of them to the second, which is looked at once. */
static int is_cut(const struct vs_hearing *how, const struct vs_scene *scene, int32_t own,
                  uint32_t who, const double own_m[3], const double other_m[3])
{
    int is_first = own < (int32_t)who;
    int32_t both[2] = {own, (int32_t)who};
    uint8_t *note = note_of(how, own_m, own, who), blocked = 0;

    if (note && *note != UNKNOWN)
        return *note == CUT;
    if (vs_rays_blocked(scene->obstacles, is_first ? own_m : other_m, is_first ? other_m : own_m, 1,
                        both, 2, &blocked) != VS_OK)
        return VS_ERR_ARGUMENT;
    if (note)
        *note = blocked ? CUT : FREE;
    return blocked;
}

/* Whether a robot hears another one that is near: 1 or 0, or an error. */
static int hears(const struct vs_hearing *how, const struct vs_scene *scene, uint32_t i,
                 const struct vs_place *place, struct vs_noticed *one)
{
    const double *other = how->places_m + 3 * (size_t)one->who;
    double east_m = other[0] - place->x_m, north_m = other[1] - place->y_m;
    double start_m[3] = {place->x_m, place->y_m, how->height_m};
    double end_m[3] = {other[0], other[1], how->height_m};
    int cut = 0;

    one->bearing_rad = vs_libm_wrap(vs_libm_bearing(north_m, east_m) - place->yaw_rad);
    if (!(fabs(one->bearing_rad) <= how->view_rad / 2.0))
        return 0;
    one->distance_m = vs_libm_distance(east_m, north_m);
    if (how->occlusions)
        cut = is_cut(how, scene, scene->own[i], one->who, start_m, end_m);
    return cut < 0 ? cut : !cut;
}

/* Fills the list of a robot, drawn or in the others' order; gives how many it would hear, or an
 * error. */
static int listen(const struct vs_hearing *how, const struct vs_scene *scene, uint32_t i,
                  int is_drawn)
{
    struct vs_place place = vs_place_of(scene, i);
    struct vs_noticed *list = how->heard + (size_t)i * how->most, one;
    const double *other = how->places_m;
    int all = 0;

    how->counts[i] = 0;
    for (one.who = 0; one.who < how->world->robots_all; one.who++, other += 3) {
        double east_m = other[0] - place.x_m, north_m = other[1] - place.y_m;
        int err;

        if (!(east_m * east_m + north_m * north_m < other[2]) || (int32_t)one.who == scene->own[i])
            continue;
        err = hears(how, scene, i, &place, &one);
        if (err < 0)
            return err;
        if (err == 0)
            continue;
        all++;
        one.key = is_drawn ? how->random->next_double(how->random->state) : NO_KEY;
        how->counts[i] = vs_notice(list, how->counts[i], how->most, &one);
    }
    return all;
}

/* Fills all lists; chance decides wherever somebody hears more than there is room for. */
static int listen_all(const struct vs_hearing *how, const struct vs_scene *scene)
{
    int is_drawn = how->shuffled, too_many = 0;
    uint32_t i;

    for (i = 0; i < scene->robots; i++) {
        int all = listen(how, scene, i, is_drawn);

        if (all < 0)
            return all;
        too_many |= (uint32_t)all > how->most;
    }
    for (i = 0; i < scene->robots && too_many && !is_drawn; i++)
        listen(how, scene, i, 1);
    return VS_OK;
}

/* Each message is lost by itself. */
static void lose(const struct vs_hearing *how, uint32_t robots)
{
    uint32_t i, k, kept;

    for (i = 0; i < robots; i++) {
        struct vs_noticed *list = how->heard + (size_t)i * how->most;

        for (k = kept = 0; k < how->counts[i]; k++)
            if (how->random->next_double(how->random->state) >= how->loss)
                list[kept++] = list[k];
        how->counts[i] = kept;
    }
}

static void write(const struct vs_hearing *how, const struct vs_noticed *list, uint32_t count,
                  double *reading)
{
    size_t width = 1 + (2 + (size_t)how->size) * how->most, at;
    uint32_t i, k;

    for (at = 0; at < width; at++)
        reading[at] = 0.0;
    *reading++ = count;
    for (i = 0; i < count; i++) {
        const struct vs_message *message = &how->messages[list[i].who];

        *reading++ = list[i].distance_m;
        *reading++ = list[i].bearing_rad;
        for (k = 0; k < how->size; k++)
            *reading++ = k < message->length ? message->data[k] : 0.0;
    }
}

int vs_hearing_read(const void *hearing, const struct vs_scene *scene, double *readings)
{
    const struct vs_hearing *how = hearing;
    size_t width = 1 + (2 + (size_t)how->size) * how->most;
    uint32_t i;
    int err;

    gather(how);
    err = listen_all(how, scene);
    if (err != VS_OK)
        return err;
    if (how->loss > 0.0)
        lose(how, scene->robots);
    vs_hearing_disturb(how, scene->robots);
    for (i = 0; i < scene->robots; i++)
        write(how, how->heard + (size_t)i * how->most, how->counts[i], readings + i * width);
    return VS_OK;
}
