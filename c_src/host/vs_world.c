/* SPDX-License-Identifier: MIT */
#include "vs_world.h"

#include <math.h>
#include <string.h>

#include "vs_math.h"

static uint32_t tag_of(const struct vs_pose_fields *fields, const uint8_t *row)
{
    uint32_t tag;

    memcpy(&tag, row + fields->tag, sizeof tag);
    return tag;
}

/* The row of a tag in a table that is sorted by tag, or NULL. */
static const uint8_t *find(const struct vs_pose_fields *fields, const uint8_t *table,
                           uint32_t count, uint32_t tag)
{
    uint32_t low = 0;
    uint32_t high = count;

    while (low < high) {
        uint32_t middle = low + (high - low) / 2;

        if (tag_of(fields, table + (size_t)middle * fields->row) < tag)
            low = middle + 1;
        else
            high = middle;
    }
    table += (size_t)low * fields->row;
    return low < count && tag_of(fields, table) == tag ? table : NULL;
}

static void update(const struct vs_pose_fields *fields, uint8_t *kept, uint32_t kept_count,
                   const uint8_t *states, uint32_t count)
{
    uint32_t i;

    for (i = 0; i < kept_count; i++) {
        uint8_t *row = kept + (size_t)i * fields->row;
        const uint8_t *fresh = find(fields, states, count, tag_of(fields, row));

        if (fresh && fresh[fields->seen])
            memcpy(row, fresh, fields->row);
        else
            row[fields->seen] = 0;
    }
}

void vs_world_update(struct vs_world *world, const uint8_t *states, uint32_t count,
                     int64_t capture_ns)
{
    const struct vs_pose_fields *fields = world->fields;
    uint32_t i;

    update(fields, world->robots, world->real, states, count);
    update(fields, world->things, world->thing_count, states, count);
    for (i = world->real; i < world->robots_all; i++) {
        uint8_t *row = world->robots + (size_t)i * fields->row;

        memcpy(row + fields->capture, &capture_ns, sizeof capture_ns);
        row[fields->seen] = 1;
    }
}

/* Puts the bodies of a table's rows, from the first of them on, where they were seen last. */
static void place(const struct vs_crowd *crowd, const uint8_t *table, uint32_t count,
                  uint32_t first, int64_t now_ns)
{
    struct vs_obstacle *bodies = crowd->bodies + first;
    const struct vs_pose_fields *fields = crowd->world->fields;
    uint32_t i;

    for (i = 0; i < count; i++, table += fields->row) {
        double at_m[3];
        int64_t capture_ns;
        int is_known;

        memcpy(at_m, table + fields->place, sizeof at_m);
        memcpy(&capture_ns, table + fields->capture, sizeof capture_ns);
        is_known = capture_ns >= 0 && now_ns - capture_ns <= crowd->memory_ns;
        bodies[i].x_m = at_m[0];
        bodies[i].y_m = at_m[1];
        if (bodies[i].half_y_m > 0.0)
            vs_sin_cos(at_m[2], &bodies[i].sine, &bodies[i].cosine);
        bodies[i].z_high_m = is_known ? crowd->heights_m[first + i] : -1.0;
    }
}

int vs_crowd_stand(struct vs_crowd *crowd, int64_t now_ns)
{
    const struct vs_world *world = crowd->world;
    int err;

    place(crowd, world->robots, world->robots_all, 0, now_ns);
    place(crowd, world->things, world->thing_count, world->robots_all, now_ns);
    err = vs_obstacles_plan(crowd->obstacles);
    if (err != VS_OK)
        return err;
    if (crowd->obstacles->words > crowd->room)
        return VS_ERR_SPACE;
    vs_obstacles_sort(crowd->obstacles, crowd->memory);
    return VS_OK;
}

/* Brings all yaws back into (-pi, pi], in the steps of wrap_angle of vsense/base/arena.py: where
 * one has left it, the last digits of the others change, too. */
static void wrap(struct vs_tracker *tracker, double *seen)
{
    int has_left = 0;
    uint32_t i;

    for (i = 0; i < tracker->count; i++)
        has_left |= fabs(seen[3 * i + 2]) > VS_PI;
    for (i = 0; i < tracker->count && has_left; i++) {
        double turn = VS_PI - seen[3 * i + 2];

        if (turn >= 2.0 * VS_PI)
            turn -= 2.0 * VS_PI;
        else if (turn < 0.0)
            turn += 2.0 * VS_PI;
        seen[3 * i + 2] = VS_PI - turn > -VS_PI ? VS_PI - turn : VS_PI;
    }
}

static double way_m(const double *from_m, const double *to_m)
{
    double east_m = to_m[0] - from_m[0];
    double north_m = to_m[1] - from_m[1];

    return vs_root(east_m * east_m + north_m * north_m);
}

void vs_tracker_see(struct vs_tracker *tracker, const double *poses, const double *errors,
                    int64_t capture_ns)
{
    const struct vs_pose_fields *fields = tracker->fields;
    double passed_s = 1e-9 * (double)(capture_ns - tracker->last_ns);
    int is_first = tracker->last_ns < 0;
    uint32_t i, k;

    for (i = 0; i < tracker->count; i++) {
        const double *pose = poses + 3 * tracker->order[i];
        uint8_t *row = tracker->states + (size_t)i * fields->row;
        double *last = tracker->last + 3 * i;
        double seen[3], speed_m_s;

        for (k = 0; k < 3; k++)
            seen[k] = pose[k] + errors[3 * i + k];
        speed_m_s = is_first ? 0.0 : way_m(last, seen) / passed_s;
        memcpy(last, seen, sizeof seen);
        memcpy(row + fields->speed, &speed_m_s, sizeof speed_m_s);
        memcpy(row + fields->capture, &capture_ns, sizeof capture_ns);
    }
    tracker->last_ns = capture_ns;
    wrap(tracker, tracker->last);
    for (i = 0; i < tracker->count; i++)
        memcpy(tracker->states + (size_t)i * fields->row + fields->place, tracker->last + 3 * i,
               3 * sizeof(double));
}
