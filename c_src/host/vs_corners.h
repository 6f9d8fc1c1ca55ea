/* SPDX-License-Identifier: MIT */
/*
 * vs_corners.h - right-angled corners of dark things that are larger than a marker: where a cable
 * or a shadow lies over a marker's border, both are one thing, and what is left of the marker are
 * its corners.
 */
#ifndef VS_CORNERS_H
#define VS_CORNERS_H

#include "vs_scan.h"

#define VS_CORNERS_LENGTH 16384 /* [px] of a border that is followed */

/* Working memory: the border of one thing, in the order of its pixels, dark to the right. */
struct vs_border {
    uint32_t count;
    int is_closed;
    uint16_t x[VS_CORNERS_LENGTH], y[VS_CORNERS_LENGTH];
};

/* A corner of something dark. */
struct vs_corner {
    double x_px, y_px;
    double place_m[2];  /* on the markers' plane */
    double map[4];      /* how that moves with the pixel [m/px], row by row */
    double inward_m[2]; /* unit vector from it between the sides that meet there */
};

/*
 * Writes the corners of all things of the newest scan that are too large for a marker, at most
 * capacity. origin is the pixel of the view's picture at which the scanned part begins.
 */
void vs_corners_find(struct vs_scan *s, const struct vs_picture *part,
                     const struct vs_search *search, const struct vs_view *view,
                     const int32_t origin[2], struct vs_border *border,
                     struct vs_corner *found, size_t capacity, size_t *count);

/*
 * Whether a marker with a corner there looks like one at a glance: light outside of its outline and
 * dark inside at most places.
 */
int vs_corners_glance(const struct vs_outline *outline, const struct vs_picture *picture,
                      const struct vs_corner *corner, const struct vs_marker *marker);

#endif
