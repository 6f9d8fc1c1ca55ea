/* SPDX-License-Identifier: MIT */
/*
 * vs_rays.h - straight lines of light and sight: which ones are blocked, and where.
 *
 * A line is blocked where it touches an obstacle, from its start to its end, both included.
 * It asks only the cells of the obstacles' grid that it passes.
 */
#ifndef VS_RAYS_H
#define VS_RAYS_H

#include <stddef.h>
#include <stdint.h>

#include "vs_err.h"
#include "vs_obstacles.h"

#define VS_RAYS_MAX_SKIPS 2 /* obstacles that one line may pass through unhindered */

/* One line, with what every obstacle needs of it. */
struct vs_line {
    double start[3];
    double way[3];  /* from start to end */
    double pace[3]; /* 1 / way, 0 where that is 0 */
    double plan2;   /* squared length seen from above */
    int32_t skip[VS_RAYS_MAX_SKIPS]; /* -1: nobody */
};

/*
 * Sets a line from start to end, which skips the obstacles at skip[0 .. skips - 1].
 * Errors: VS_ERR_ARGUMENT for a coordinate that is not finite or is beyond
 * VS_OBSTACLES_LIMIT_M, or for more than VS_RAYS_MAX_SKIPS.
 */
int vs_rays_aim(struct vs_line *line, const double start[3], const double end[3],
                const int32_t *skip, size_t skips);

/*
 * Cuts the part [*from, *to] of a line down to where its coordinate (0: x, 1: y, 2: z) lies
 * in [low, high]; 0 if nothing is left.
 */
int vs_rays_cut(const struct vs_line *line, int axis, double low, double high, double *from,
                double *to);

/*
 * The share of the line, in [0, 1], up to where it first touches a body, or infinity; with
 * any it may be any touch. Skips do not count.
 */
double vs_rays_meet(const struct vs_obstacle *body, const struct vs_line *line, int any);

/* The same for all obstacles but those that the line skips. */
double vs_rays_trace(const struct vs_obstacles *obstacles, const struct vs_line *line,
                     int any);

/*
 * Of lines from starts[i] to ends[i], i < count, three coordinates each: blocked[i] is 1
 * where an obstacle is touched, else 0. skip holds skips <= VS_RAYS_MAX_SKIPS numbers of obstacles
 * for every line, one after the other: these do not count; -1 is nobody.
 * Errors: as vs_rays_aim.
 */
int vs_rays_blocked(const struct vs_obstacles *obstacles, const double *starts,
                    const double *ends, size_t count, const int32_t *skip, size_t skips,
                    uint8_t *blocked);

/*
 * The same lines: shares[i] is the part of the line, in [0, 1], up to where it first
 * touches an obstacle, or infinity. 0 where it starts in one. Errors as above.
 */
int vs_rays_nearest(const struct vs_obstacles *obstacles, const double *starts,
                    const double *ends, size_t count, const int32_t *skip, size_t skips,
                    double *shares);

#endif
