/* SPDX-License-Identifier: MIT */
/*
 * vs_shape.h - which components of a scan look like an arrow: their size, and the
 * moments of their convex hull, which blur and white cells leave as it is.
 */
#ifndef VS_SHAPE_H
#define VS_SHAPE_H

#include <stddef.h>
#include <stdint.h>

#include "vs_err.h"
#include "vs_scan.h"

#define VS_SHAPE_ROWS 256 /* scanned rows of the tallest component looked at */

/* What an arrow looks like from the camera's height; ratios are of the hull. */
struct vs_shape_gate {
    double length_px;    /* between the two corners farthest apart */
    double area_px2;     /* of the outline, cells included */
    double least_area;   /* accepted share of area_px2 (0.4) */
    double most_area;    /* accepted share of area_px2 (1.6) */
    double least_aspect; /* variance along over variance across (1.2) */
    double most_aspect;  /* the same (2.9) */
    double least_taper;  /* how much it must come to a point (0.12) */
};

/* A component that may be an arrow. */
struct vs_shape {
    double x_px;    /* centroid of its hull */
    double y_px;
    double ahead_x; /* unit vector in the picture from the centroid towards the tip */
    double ahead_y;
};

/*
 * Writes the components of the newest scan that pass the gate, at most capacity;
 * more set VS_SCAN_FULL_FOUND. Never fails.
 */
void vs_shape_find(struct vs_scan *s, const struct vs_shape_gate *gate,
                   struct vs_shape *found, size_t capacity, size_t *count);

#endif
