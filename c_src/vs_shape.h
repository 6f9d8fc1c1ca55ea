/* SPDX-License-Identifier: MIT */
/*
 * vs_shape.h - which components of a scan look like an arrow: their size, and the
 * moments of their convex hull, which blur and white cells leave as it is. Moments
 * are mapped to the markers' plane first: perspective turns a thing's longest axis.
 */
#ifndef VS_SHAPE_H
#define VS_SHAPE_H

#include <stddef.h>
#include <stdint.h>

#include "vs_err.h"
#include "vs_scan.h"

#define VS_SHAPE_ROWS 256 /* scanned rows of the tallest component looked at */

/* What an arrow looks like: its size in the picture, its proportions on its plane. */
struct vs_shape_gate {
    double length_px;    /* between the two corners farthest apart */
    double area_px2;     /* of the outline, cells included */
    double least_area;   /* accepted share of area_px2 (0.4) */
    double most_area;    /* accepted share of area_px2 (1.6) */
    double least_aspect; /* variance along over variance across (1.2) */
    double most_aspect;  /* the same (2.9) */
    double least_taper;  /* how much it must come to a point (0.12) */
};

/* Central moments of an area, divided by it: the mean of x^2, of x y, and so on. */
struct vs_moments {
    double xx, xy, yy;
    double xxx, xxy, xyy, yyy;
};

/* A component that has the size of an arrow, by its hull. */
struct vs_shape {
    double x_px; /* centroid */
    double y_px;
    struct vs_moments moments; /* in the picture */
};

/*
 * Writes the components of the newest scan whose size passes the gate, at most
 * capacity; more set VS_SCAN_FULL_FOUND. Never fails.
 */
void vs_shape_find(struct vs_scan *s, const struct vs_shape_gate *gate,
                   struct vs_shape *found, size_t capacity, size_t *count);

/*
 * Tells whether something with these moments tapers like an arrow, and whereto:
 * ahead is a unit vector from the centroid towards the tip. map is the matrix
 * (row by row) that takes the moments' x and y to those in which an arrow has its
 * true proportions. Returns 1, or 0 for what is no arrow.
 */
int vs_shape_points(const struct vs_moments *moments, const double map[4],
                    const struct vs_shape_gate *gate, double ahead[2]);

#endif
