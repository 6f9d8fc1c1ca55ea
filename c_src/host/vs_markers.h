/* SPDX-License-Identifier: MIT */
/*
 * vs_markers.h - the picture kernel: from a picture to the fitted markers in it, with what their
 * cells alone say of their tags.
 *
 * Points go through the lens model, pictures never do.
 */
#ifndef VS_MARKERS_H
#define VS_MARKERS_H

#include "vs_view.h"

/* What a search had no room for; its other results are good. */
#define VS_MARKERS_FULL_RUNS 1  /* rows further down were not scanned */
#define VS_MARKERS_FULL_PARTS 2 /* rows further down were not scanned */
#define VS_MARKERS_FULL_FOUND 4 /* the caller's table was too small for all things found */

#define VS_MARKERS_SIDE 8192 /* [px] greatest width and height of a picture */

#define VS_MARKERS_BLOCK 16  /* [px] side of the blocks of a picture that have one threshold */
#define VS_MARKERS_AGAIN 2   /* scans of a picture after the first */
#define VS_OUTLINE_SAMPLES 96 /* points along an outline */
#define VS_OUTLINE_STEPS 15   /* grey values along one normal */
#define VS_OUTLINE_CELLS 25   /* of a marker: 5 x 5 */
#define VS_OUTLINE_SPOTS 9    /* grey values read in each cell */
#define VS_OUTLINE_RIM 16     /* points that must be in the picture */
#define VS_OUTLINE_PASSES 4   /* of a fit */

/* One pass of a fit, and what a marker must show in it to be kept. */
struct vs_outline_pass {
    double reach_m;          /* how far to look inwards and outwards */
    int32_t steps;           /* grey values along each normal, 4 .. VS_OUTLINE_STEPS */
    int32_t stride;          /* every how many samples are used, 1 .. */
    double least_coverage;   /* share of the samples that find their edge */
    double most_residual_m;  /* root mean square distance of edges to the outline */
};

struct vs_words; /* see vs_words.h */
struct vs_codes; /* see vs_codes.h */

/*
 * A family's outline and cells, in metres, x ahead and y to the left: from the disc's centre, or
 * from the middle of an upright square. Made once; all threads may read it.
 */
struct vs_outline {
    const struct vs_words *words; /* of square markers; NULL of others */
    const struct vs_codes *codes; /* the roster's, of arrows; NULL where they are not named */
    int32_t samples;
    int32_t cells;
    int32_t passes;
    double unit_m;         /* the family's length u */
    double scale_doubt;    /* accepted difference of the scale from 1 */
    double least_contrast; /* [grey] white over black */
    int32_t rims;
    double rim_x_m[VS_OUTLINE_RIM]; /* what must be in the picture: a disc's rim, or corners */
    double rim_y_m[VS_OUTLINE_RIM];
    double x_m[VS_OUTLINE_SAMPLES], y_m[VS_OUTLINE_SAMPLES];
    double normal_x[VS_OUTLINE_SAMPLES]; /* unit vectors, outwards */
    double normal_y[VS_OUTLINE_SAMPLES];
    double spot_x_m[VS_OUTLINE_CELLS * VS_OUTLINE_SPOTS];
    double spot_y_m[VS_OUTLINE_CELLS * VS_OUTLINE_SPOTS];
    struct vs_outline_pass stage[VS_OUTLINE_PASSES];
};

/* A marker in a picture. */
struct vs_marker {
    double x_m, y_m;   /* the disc's centre in the arena frame */
    double ahead_x, ahead_y; /* unit vector of the heading */
    double scale;      /* size, relative to the family's */
    double x_px, y_px; /* picture of the disc's centre */
    double residual_m; /* root mean square distance of the edges found to the outline */
    double coverage;   /* share of the samples that found their edge */
    double black;      /* [grey] median just inside the outline */
    double white;      /* [grey] median just outside */
    double sharp_ahead; /* share of the contrast that an edge across the heading gains */
    double sharp_left;  /* within a quarter u of it; the same for one along it */
    double tag;           /* a whole number, -1 where none could be read */
    double guess;         /* the nearest tag, read or not; -1: none is near */
    double error, margin; /* see struct vs_reading and vs_codes_name */
    double cell[VS_OUTLINE_CELLS]; /* 0 the outline's black, 1 the disc's white; of others */
};

/* What a marker looks like: its size in the picture, its proportions on its plane. */
struct vs_shape_gate {
    double least_px;     /* sides of the box around it, where a picture shows it smallest */
    double most_px;      /* and where it is largest: an inclined camera has both */
    double least_px2, most_px2; /* area of the outline, cells included; likewise */
    double least_m2, most_m2;   /* the same on its plane, where it is */
    double least_aspect; /* variance along over variance across (1.2) */
    double most_aspect;  /* the same (2.9) */
    double least_taper;  /* how much it must come to a point (0.12) */
    double least_square; /* how much corners: a square has 0.6, a disc 0; 0 of an arrow */
};

struct vs_rescan {
    int32_t level_256, least_light; /* as below, 0: none; [grey] where it looks, 0: everywhere */
};

/* How to search. */
struct vs_search {
    int32_t least_contrast; /* [grey] light ground over dark things; noise raises it (36) */
    int32_t level_256;      /* threshold between the darkest, 0, and the lightest, 256 (100) */
    int32_t pale_contrast;  /* [grey] least_contrast where nothing has much, and a veil; 0: none */
    double pale_fit;        /* [grey] least_contrast of the outline there */
    struct vs_rescan again[VS_MARKERS_AGAIN]; /* scans for what those before did not show */
    int32_t print_256;      /* share of the light ground that ink is darker by, at least (102) */
    int32_t has_veil;       /* whether the picture's darkest counts as 0 in that (0) */
    const uint8_t *outside; /* of each block of a whole picture: not 0: skip it; NULL: none */
    double lead_m;          /* from the outline's centroid ahead to the disc's centre */
    double least_apart_m;   /* of two markers; of closer ones the better fit is kept */
    struct vs_shape_gate gate;
};

/* A part of a picture; columns left .. right - 1, rows top .. bottom - 1. */
struct vs_window {
    int32_t left, top, right, bottom;
};

/* Working memory, the caller's; one thread at a time. Its content is of no meaning before. */
struct vs_markers;

/*
 * [byte] of that memory for pictures of up to that many pixels, whatever their shape; it is to be
 * aligned as for a double. Sides are cut to 0 .. VS_MARKERS_SIDE.
 */
size_t vs_markers_size(int32_t width_px, int32_t height_px);

/*
 * Looks for markers in a part of the picture, for which there is work; windows are cut to it.
 * Appends those found to markers[*count ..] and keeps all of them apart. Returns the
 * VS_MARKERS_FULL_... of what there was no room for: 0 if all is well.
 * Errors: VS_ERR_ARGUMENT for a picture larger than VS_MARKERS_SIDE or smaller than 0, too small
 * a stride, levels or a print_256 that are none, or an outline beyond the counts above.
 */
int vs_markers_search(struct vs_markers *work, const struct vs_search *search,
                      const struct vs_outline *outline, const struct vs_view *view,
                      const struct vs_window *window, struct vs_marker *markers,
                      size_t capacity, size_t *count);

/*
 * Fits markers from poses that are known about: those that fit move to the front,
 * *count of them, with their place before in origin. The passes of first are tried before those of
 * outline, which may ask for less and take longer; NULL: none.
 * Errors: VS_ERR_ARGUMENT for pictures and outlines as above.
 */
int vs_markers_follow(const struct vs_outline *first, const struct vs_outline *outline,
                      const struct vs_view *view, struct vs_marker *markers, uint32_t *origin,
                      size_t *count);

#endif
