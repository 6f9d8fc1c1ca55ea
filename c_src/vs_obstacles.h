/* SPDX-License-Identifier: MIT */
/*
 * vs_obstacles.h - bodies that stand in the way of light and sight, in a uniform grid seen
 * from above: upright cylinders and upright boxes. Lengths in m, arena frame.
 */
#ifndef VS_OBSTACLES_H
#define VS_OBSTACLES_H

#include <stdint.h>

#include "vs_err.h"

#define VS_OBSTACLES_LIMIT_M 100000 /* [m] no coordinate may be farther from the origin */

struct vs_obstacle {
    double x_m;        /* its middle */
    double y_m;
    double z_low_m;    /* where it begins and ends; with z_high_m < z_low_m it is not there */
    double z_high_m;
    double radius_m;   /* > 0: a cylinder */
    double half_x_m;   /* else a box: half its extents along its own axes, >= 0 */
    double half_y_m;
    double cosine;     /* of the box's turn */
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
 * The column of a place so far along x from the grid's corner, or the row of one so far
 * along y: the nearest of so many cells.
 */
int32_t vs_obstacles_cell(const struct vs_obstacles *obstacles, double from_corner_m,
                          int32_t cells);

#endif
