/* SPDX-License-Identifier: MIT */
/*
 * vs_rays.h - straight lines of light and sight among obstacles: which ones are blocked,
 * and where. Lengths in m, arena frame.
 *
 * Obstacles are upright cylinders and upright boxes in a uniform grid seen from above. A
 * line is blocked where it touches one, from its start to its end, both included; it asks
 * only the cells that it passes.
 */
#ifndef VS_RAYS_H
#define VS_RAYS_H

#include <stddef.h>
#include <stdint.h>

#include "../vs_err.h"

#define VS_OBSTACLES_LIMIT_M 100000 /* [m] no coordinate may be farther from the origin */
#define VS_RAYS_MAX_SKIPS 2         /* obstacles that one line may pass through unhindered */

struct vs_obstacle {
    double x_m;        /* its middle */
    double y_m;
    double z_low_m;    /* where it begins and ends; with z_high_m < z_low_m it is not there */
    double z_high_m;
    double radius_m;   /* > 0: a cylinder, which may have a nose: a second, so far ahead of its */
    double half_x_m;   /* middle and with this radius, 0: none. Else a box: half its extents */
    double half_y_m;   /* along its own axes, >= 0 */
    double cosine;     /* of its turn */
    double sine;
};

/* Bodies in their grid. The caller sets the first two and keeps bodies and memory alive. */
struct vs_obstacles {
    const struct vs_obstacle *bodies;
    uint32_t count;
    uint32_t words;          /* of memory that vs_obstacles_sort wants; from vs_obstacles_plan */
    int32_t columns;         /* of the grid */
    int32_t rows;
    double left_m;           /* its corner with the lowest x and y */
    double near_m;
    double cell_m;           /* side of a cell */
    double low_m;            /* between these heights all bodies are */
    double high_m;
    const uint32_t *first;   /* [cells + 1] where each cell's bodies begin in inside */
    const uint32_t *inside;  /* numbers of bodies, cell by cell */
};

/*
 * Lays the grid over the bodies and counts the memory that it takes.
 * Errors: VS_ERR_ARGUMENT for a number that is not finite, negative where it must not be,
 * or beyond VS_OBSTACLES_LIMIT_M.
 */
int vs_obstacles_plan(struct vs_obstacles *obstacles);

/* Sorts the bodies into the planned grid; memory is obstacles->words long. */
void vs_obstacles_sort(struct vs_obstacles *obstacles, uint32_t *memory);

/*
 * Of lines from starts[i] to ends[i], i < count, three coordinates each: blocked[i] is 1
 * where an obstacle is touched, else 0. skip holds skips <= VS_RAYS_MAX_SKIPS numbers of
 * obstacles for every line, one after the other: these do not count; -1 is nobody.
 * Errors: VS_ERR_ARGUMENT for a coordinate that is not finite or is beyond
 * VS_OBSTACLES_LIMIT_M, or for more than VS_RAYS_MAX_SKIPS.
 */
int vs_rays_blocked(const struct vs_obstacles *obstacles, const double *starts,
                    const double *ends, size_t count, const int32_t *skip, size_t skips,
                    uint8_t *blocked);

/*
 * The same lines: shares[i] is the part of the line, in [0, 1], up to where it first
 * touches an obstacle, or infinity. 0 where it starts in one, but for noses, which a line that
 * starts in them does not touch. Errors as above.
 */
int vs_rays_nearest(const struct vs_obstacles *obstacles, const double *starts,
                    const double *ends, size_t count, const int32_t *skip, size_t skips,
                    double *shares);

/*
 * Which points see which goals, three coordinates each: seen[i * goals + k] is 1 where goal
 * k is seen from point i, else 0. skip holds skips numbers of obstacles for every point, one
 * after the other: these do not count; -1 is nobody. Quick where neighbours in the list are
 * neighbours in the arena: what may stand between them and a goal is searched for once.
 * Errors: as vs_rays_blocked.
 */
int vs_sight_seen(const struct vs_obstacles *obstacles, const double *points, size_t count,
                  const double *goals_at, size_t goals, const int32_t *skip, size_t skips,
                  uint8_t *seen);

#endif
