/* SPDX-License-Identifier: MIT */
/*
 * vs_markers.h - the whole kernel in one call: from a picture to the fitted markers
 * in it, with their cells. What the cells mean, and what to believe, is for others.
 */
#ifndef VS_MARKERS_H
#define VS_MARKERS_H

#include <stddef.h>

#include "vs_err.h"
#include "vs_outline.h"
#include "vs_scan.h"
#include "vs_shape.h"

#define VS_MARKERS_SHAPES 1024 /* candidates in a picture */

/* How to search. */
struct vs_search {
    int32_t least_contrast; /* [grey] see vs_scan_picture (36) */
    int32_t level_256;      /* see vs_scan_picture (100) */
    double lead_m;          /* from the outline's centroid ahead to the disc's centre */
    double least_apart_m;   /* of two markers; of closer ones the better fit is kept */
    struct vs_shape_gate gate;
};

/* A part of a picture; columns left .. right - 1, rows top .. bottom - 1. */
struct vs_window {
    int32_t left;
    int32_t top;
    int32_t right;
    int32_t bottom;
};

/* Working memory, the caller's; one thread at a time. */
struct vs_markers {
    uint32_t full; /* VS_SCAN_FULL_... of the newest call: its other results are good */
    uint32_t shape_count;
    struct vs_shape shapes[VS_MARKERS_SHAPES];
    struct vs_scan scan;
};

/*
 * Looks for markers in a part of the picture; windows are cut to it. Appends those
 * found to markers[*count ..] and keeps all of them apart.
 * Errors: VS_ERR_ARGUMENT for what vs_scan_picture and vs_outline_check refuse.
 */
int vs_markers_search(struct vs_markers *work, const struct vs_search *search,
                      const struct vs_outline *outline, const struct vs_view *view,
                      const struct vs_window *window, struct vs_marker *markers,
                      size_t capacity, size_t *count);

/*
 * Fits markers from poses that are known about: those that fit move to the front,
 * *count of them, with their place before in origin. Errors: VS_ERR_ARGUMENT.
 */
int vs_markers_follow(const struct vs_outline *outline, const struct vs_view *view,
                      struct vs_marker *markers, uint32_t *origin, size_t *count);

#endif
