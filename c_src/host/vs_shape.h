/* SPDX-License-Identifier: MIT */
/*
 * vs_shape.h - which components of a scan look like an arrow or a square: their size, and the
 * moments of their convex hull, which blur and white cells leave as it is. Moments
 * are mapped to the markers' plane first: perspective turns a thing's longest axis.
 */
#ifndef VS_SHAPE_H
#define VS_SHAPE_H

#include "vs_scan.h"

#define VS_SHAPE_ROWS 256 /* scanned rows of the tallest component looked at */

/* Central moments of an area, divided by it: the mean of x^2, of x y, and so on. */
struct vs_moments {
    double xx, xy, yy;
    double xxx, xxy, xyy, yyy;
    double xxxx, xxxy, xxyy, xyyy, yyyy; /* where squares are looked for */
};

/* A component that has the size of a marker, by its hull. */
struct vs_shape {
    double x_px; /* centroid */
    double y_px;
    double area_px2;
    struct vs_moments moments; /* in the picture */
};

/*
 * Writes the components of the newest scan whose size passes the gate, at most
 * capacity; more set VS_MARKERS_FULL_FOUND. Never fails.
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

/* The same for a square: ahead is a unit vector along any of its sides. */
int vs_shape_corners(const struct vs_moments *moments, const double map[4],
                     const struct vs_shape_gate *gate, double ahead[2]);

#endif
