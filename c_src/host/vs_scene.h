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

/* One sensor's readings of all robots, as they are sent. */
struct vs_sent {
    uint32_t robots;
    uint32_t count;        /* numbers of a reading */
    uint8_t *block;        /* where they go: singles, in any alignment, stride bytes from robot */
    size_t stride;         /* to robot */
    int64_t *captures_ns;  /* when they were measured: [robots], step numbers apart */
    size_t step;
    double *fresh;         /* [robots * count] what the sensor reads */
    const double *offsets; /* [robots * count] noise, in units; NULL: a perfect sensor */
    const double *unit;    /* [count] for offsets only: what 1 means, */
    const double *low;     /* [count] and the sensor's bounds */
    const double *high;
};

/*
 * Sends what was read at capture_ns. Errors: VS_ERR_ARGUMENT for a number that is not finite or
 * too large for a single; nothing of that robot is sent then.
 */
int vs_sent_renew(const struct vs_sent *sent, int64_t capture_ns);

#endif
