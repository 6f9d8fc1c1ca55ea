/* SPDX-License-Identifier: MIT */
/*
 * vs_field.h - a concentration on the floor, in square cells: read between the cells, left
 * behind, and spreading. Lengths in m, arena frame.
 */
#ifndef VS_FIELD_H
#define VS_FIELD_H

#include <stdint.h>

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

/* Moves a share of every difference between neighbours from one to the other; before is room for
 * rows * columns numbers. */
void vs_field_diffuse(struct vs_field *field, double share, double *before);

#endif
