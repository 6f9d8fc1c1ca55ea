/* SPDX-License-Identifier: MIT */
/*
 * vs_markers.h - the picture kernel: from a picture to the fitted markers in it, with what their
 * cells alone say of their tags.
 *
 * Points go through the lens model, pictures never do.
 */
#ifndef VS_MARKERS_H
#define VS_MARKERS_H

#include "vs_search.h"
#include "vs_view.h"

/* What a search had no room for; its other results are good. */
#define VS_MARKERS_FULL_RUNS 1  /* rows further down were not scanned */
#define VS_MARKERS_FULL_PARTS 2 /* rows further down were not scanned */
#define VS_MARKERS_FULL_FOUND 4 /* the caller's table was too small for all things found */

#define VS_MARKERS_SIDE 8192 /* [px] greatest width and height of a picture */

#define VS_MARKERS_BLOCK 16  /* [px] side of the blocks of a picture that have one threshold */
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
