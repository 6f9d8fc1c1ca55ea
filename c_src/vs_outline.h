/* SPDX-License-Identifier: MIT */
/*
 * vs_outline.h - the precise pose of a marker: its outline fitted to the picture
 * through the lens model. Samples along the outline look along their normals for
 * the step from black to white; position, heading and scale on the markers' plane
 * follow by robust least squares.
 */
#ifndef VS_OUTLINE_H
#define VS_OUTLINE_H

#include <stdint.h>

#include "vs_err.h"
#include "vs_lens.h"
#include "vs_scan.h"

#define VS_OUTLINE_SAMPLES 96 /* points along an outline */
#define VS_OUTLINE_STEPS 15   /* grey values along one normal */
#define VS_OUTLINE_CELLS 25   /* of a marker: 5 x 5 */
#define VS_OUTLINE_SPOTS 9    /* grey values read in each cell */
#define VS_OUTLINE_PASSES 4   /* of a fit */
#define VS_OUTLINE_SHARP_256 64 /* [u/256] to both sides of an edge: how sharp it is */

/* One pass of a fit, and what a marker must show in it to be kept. */
struct vs_outline_pass {
    double reach_m;          /* how far to look inwards and outwards */
    int32_t steps;           /* grey values along each normal, 4 .. VS_OUTLINE_STEPS */
    int32_t stride;          /* every how many samples are used, 1 .. */
    double least_coverage;   /* share of the samples that find their edge */
    double most_residual_m;  /* root mean square distance of edges to the outline */
};

/*
 * A family's outline and cells, in metres from the disc's centre, x ahead and y to
 * the left. Made once; all threads may read it.
 */
struct vs_outline {
    int32_t samples;
    int32_t cells;
    int32_t passes;
    double unit_m;         /* the family's length u */
    double scale_doubt;    /* accepted difference of the scale from 1 */
    double least_contrast; /* [grey] white over black */
    double radius_m;       /* of the disc */
    double x_m[VS_OUTLINE_SAMPLES];
    double y_m[VS_OUTLINE_SAMPLES];
    double normal_x[VS_OUTLINE_SAMPLES]; /* unit vectors, outwards */
    double normal_y[VS_OUTLINE_SAMPLES];
    double spot_x_m[VS_OUTLINE_CELLS * VS_OUTLINE_SPOTS];
    double spot_y_m[VS_OUTLINE_CELLS * VS_OUTLINE_SPOTS];
    struct vs_outline_pass stage[VS_OUTLINE_PASSES];
};

/* What a picture is of: the camera and the height of the markers above the floor. */
struct vs_view {
    struct vs_picture picture;
    struct vs_lens lens;
    double height_m;
};

/* A marker in a picture. */
struct vs_marker {
    double x_m;        /* the disc's centre in the arena frame */
    double y_m;
    double ahead_x;    /* unit vector of the heading */
    double ahead_y;
    double scale;      /* size, relative to the family's */
    double x_px;       /* picture of the disc's centre */
    double y_px;
    double residual_m; /* root mean square distance of the edges found to the outline */
    double coverage;   /* share of the samples that found their edge */
    double black;      /* [grey] median just inside the outline */
    double white;      /* [grey] median just outside */
    double sharp_ahead; /* share of the contrast that an edge across the heading gains */
    double sharp_left;  /* within VS_OUTLINE_SHARP_256; the same for one along it */
    double cell[VS_OUTLINE_CELLS]; /* 0 the outline's black, 1 the disc's white */
};

/* Checks an outline's counts and passes. Errors: VS_ERR_ARGUMENT. */
int vs_outline_check(const struct vs_outline *outline);

/*
 * Fits a marker from where x_m, y_m, ahead and scale say that it is. Returns 1 if
 * it passes every pass and lies wholly in the picture, else 0.
 */
int vs_outline_fit(const struct vs_outline *outline, const struct vs_view *view,
                   struct vs_marker *marker);

/* Reads the cells and the pixel of a marker that has been fitted. */
void vs_outline_read(const struct vs_outline *outline, const struct vs_view *view,
                     struct vs_marker *marker);

#endif
