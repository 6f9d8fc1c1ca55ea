/* SPDX-License-Identifier: MIT */
/*
 * vs_line.h - one line and one obstacle, and the cells that a line passes: what the files
 * behind vs_rays.h share. The functions are in vs_rays.c and vs_obstacles.c.
 */
#ifndef VS_LINE_H
#define VS_LINE_H

#include "vs_rays.h"

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
int vs_line_aim(struct vs_line *line, const double start[3], const double end[3],
                const int32_t *skip, size_t skips);

/*
 * Cuts the part [*from, *to] of a line down to where its coordinate (0: x, 1: y, 2: z) lies
 * in [low, high]; 0 if nothing is left.
 */
int vs_line_cut(const struct vs_line *line, int axis, double low, double high, double *from,
                double *to);

/*
 * The share of the line, in [0, 1], up to where it first touches a body, or infinity; with
 * any it may be any touch. Skips do not count.
 */
double vs_line_meet(const struct vs_obstacle *body, const struct vs_line *line, int any);

/* Whether a body has a nose, and which obstacle that is. */
int vs_line_has_nose(const struct vs_obstacle *body, struct vs_obstacle *nose);

/*
 * The column of a place so far along x from the grid's corner, or the row of one so far
 * along y: the nearest of so many cells.
 */
int32_t vs_line_cell(const struct vs_obstacles *obstacles, double from_corner_m,
                     int32_t cells);

/*
 * Whether a body, but skip, comes within reach_m of a place, seen from above: 0 where none does,
 * 1 where one does or nearly does. Errors: VS_ERR_ARGUMENT for a place as in vs_line_aim.
 */
int vs_line_near(const struct vs_obstacles *obstacles, double x_m, double y_m, double reach_m,
                 int32_t skip);

#endif
