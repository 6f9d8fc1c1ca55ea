/* SPDX-License-Identifier: MIT */
/*
 * vs_field.h - a concentration on the floor, in square cells: read between the cells, left
 * behind, and spreading. Lengths in m, arena frame.
 */
#ifndef VS_FIELD_H
#define VS_FIELD_H

#include "vs_scene.h"

/* The arrays are the caller's. */
struct vs_field {
    uint32_t columns; /* >= 1, as rows */
    uint32_t rows;
    double corner_m[2]; /* of the first cell: lowest x and y */
    double cell_m;
    double *cells;      /* [rows * columns] concentration, row by row */
};

/* Reads n points, x and y each: three numbers each, the concentration, and its gradient along x and
 * y, taken over two cells and 0 across the border. Outside is as the nearest place inside. */
void vs_field_read(const struct vs_field *field, const double *points_m, uint32_t n,
                   double *readings);

/* Adds amounts [n] at points, shared out between the four nearest cells; no cell gets more than
 * most. */
void vs_field_deposit(struct vs_field *field, const double *points_m, const double *amounts,
                      uint32_t n, double most);

/* What a field does in a timestep. */
struct vs_spread {
    struct vs_field *field;
    uint32_t substeps; /* in each of which a share of every difference between neighbours moves */
    double share;      /* from one to the other */
    double left;       /* in the end every cell is multiplied by this */
    double *before;    /* [rows * columns] scratch */
};

void vs_spread_step(const struct vs_spread *spread);

/* A sensor: the concentration under every robot, and its gradient along the robot's own axes, ahead
 * and left; field is a struct vs_field. VS_OK. */
int vs_field_sense(const void *field, const struct vs_scene *scene, double *readings);

/* How robots leave something in a field. */
struct vs_release {
    struct vs_field *field;
    double timestep_s;
    double most;
};

/* An actuator: every robot leaves levels[2 * i] per second, and growth[2 * i + 1], where it stands;
 * release is a struct vs_release. Errors: VS_ERR_ARGUMENT, an amount is larger than most. */
int vs_field_release(const void *release, const struct vs_scene *scene, const double *levels,
                     const double *growth);

#endif
