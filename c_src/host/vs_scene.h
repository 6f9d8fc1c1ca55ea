/* SPDX-License-Identifier: MIT */
/*
 * vs_scene.h - what sensors that are C read: where robots are, lights, and what stands in
 * the way; and how what they read travels. Lengths in m, arena frame; times in ns.
 */
#ifndef VS_SCENE_H
#define VS_SCENE_H

#include <stddef.h>
#include <stdint.h>

struct vs_light {
    double at_m[3];
    double intensity; /* > 0 */
};

struct vs_obstacles;

/* All arrays are the caller's. */
struct vs_scene {
    const uint8_t *first;       /* robots: x, y and yaw as three doubles, in any alignment, */
    size_t stride;              /* so many bytes apart */
    uint32_t robots;
    uint32_t lights_count;
    const int32_t *own;         /* [robots] number of each one's body, -1: none */
    const struct vs_light *lights;
    const struct vs_obstacles *obstacles;
};

/* Types of numbers as they travel: singles, and whole numbers with and without a sign. */
#define VS_NUMBER_F4 0
#define VS_NUMBER_U1 1
#define VS_NUMBER_I2 2
#define VS_NUMBER_U2 3
#define VS_NUMBER_I4 4
#define VS_NUMBER_U4 5

/* One sensor's readings of all robots, as they are sent. */
struct vs_sent {
    uint32_t robots;
    uint32_t count;        /* numbers of a reading */
    uint32_t type;         /* VS_NUMBER_... */
    uint8_t *block;        /* where they go: in any alignment, stride bytes from robot to robot */
    size_t stride;
    int64_t *captures_ns;  /* when they were measured: [robots], step numbers apart */
    size_t step;
    double *fresh;         /* [robots * count] what the sensor reads */
    const double *offsets; /* [robots * count] noise, in units; NULL: a perfect sensor */
    const double *unit;    /* [count] for offsets only: what 1 means, */
    const double *low;     /* [count] and the sensor's bounds */
    const double *high;
};

/*
 * Sends what was read at capture_ns; whole numbers are the nearest. Errors: VS_ERR_ARGUMENT for a
 * number that is not finite or does not fit the type; nothing of that robot is sent then.
 */
int vs_sent_renew(const struct vs_sent *sent, int64_t capture_ns);

/* One actuator's reports of all robots: levels, which hold, and counters, whose growth counts. */
struct vs_heard {
    uint32_t robots;
    uint32_t count;       /* numbers of a report */
    uint32_t type;        /* VS_NUMBER_... */
    const uint8_t *block; /* where they come from, as in struct vs_sent */
    size_t stride;
    const double *low;    /* [count] bounds of what is believed */
    const double *high;
    double *last;         /* [robots * count] the counts of the call before */
    double *levels;       /* [robots * count] what all numbers are, 0 for what is none, */
    double *growth;       /* [robots * count] and by how much each has grown; after a restart a */
};                        /* robot counts from 0 */

#endif
