/* SPDX-License-Identifier: MIT */
/*
 * vs_world.h - robots and tagged things as they were seen last, and the crowd of bodies that
 * they are to light and sight. Lengths in m, arena frame; times in ns.
 */
#ifndef VS_WORLD_H
#define VS_WORLD_H

#include "vs_rays.h"

/* Where a row of a table of poses (POSE of vsense/base/arena.py) has what is used here [byte]. */
struct vs_pose_fields {
    uint32_t row;     /* size of a row */
    uint32_t tag;     /* uint32_t */
    uint32_t place;   /* double x_m, y_m, yaw_rad */
    uint32_t speed;   /* double speed_m_s */
    uint32_t capture; /* int64_t capture_ns, negative: never seen */
    uint32_t seen;    /* uint8_t 0 or 1 */
};

/* Last sightings, in tables of poses. All arrays are the caller's. */
struct vs_world {
    const struct vs_pose_fields *fields;
    uint8_t *robots;
    uint32_t real;       /* robots that cameras see: the first ones */
    uint32_t robots_all;
    uint8_t *things;     /* tagged things that are no robots */
    uint32_t thing_count;
};

/*
 * Takes over an arena state, a table of poses sorted by tag: rows of tags that were seen are
 * overwritten, the others stay, not seen. Virtual robots are seen where they are.
 */
void vs_world_update(struct vs_world *world, const uint8_t *states, uint32_t count,
                     int64_t capture_ns);

/* What stands in the way: robots and tagged things, and what stands there for good. */
struct vs_crowd {
    const struct vs_world *world;
    struct vs_obstacle *bodies; /* [obstacles->count] robots, things, what stands: the caller
                                   sets everything but places, turns and heights of the first
                                   two */
    const double *heights_m;    /* of robots, then of things */
    int64_t memory_ns;          /* who was not seen for longer is not there */
    struct vs_obstacles *obstacles;
    uint32_t *memory;           /* [room] */
    uint32_t room;
};

/*
 * Sorts the bodies anew, as they were last seen at now_ns. Errors: VS_ERR_SPACE where there is
 * less room than obstacles->words, and those of vs_obstacles_plan.
 */
int vs_crowd_stand(struct vs_crowd *crowd, int64_t now_ns);

/* A tracker of a simulation: it sees everything, with small errors. */
struct vs_tracker {
    const struct vs_pose_fields *fields;
    uint32_t count;
    const uint32_t *order; /* [count] number of the pose that each row of states is of */
    uint8_t *states;       /* [count] table of poses, sorted by tag */
    double *last;          /* [count * 3] what it saw last, and when; negative: nothing yet */
    int64_t last_ns;
};

/*
 * Makes the states of true poses [count * 3] at a later time than before; errors [count * 3], in
 * the rows' order, are added. Yaws of the states are in (-pi, pi], if poses are.
 */
void vs_tracker_see(struct vs_tracker *tracker, const double *poses, const double *errors,
                    int64_t capture_ns);

#endif
