/* SPDX-License-Identifier: MIT */
/*
 * vs_edges.h - what a picture shows along the outline of a marker: grey values along
 * its normals, where in them the edge is, and how sharp it is.
 */
#ifndef VS_EDGES_H
#define VS_EDGES_H

#include "vs_markers.h"

/* What one pass sees: a row of grey values per sample, from inside to outside. */
struct vs_profiles {
    int count;
    int sample[VS_OUTLINE_SAMPLES];
    float grey[VS_OUTLINE_SAMPLES][VS_OUTLINE_STEPS];
};

/* Where the samples' edges are, along their normals. */
struct vs_edges {
    float offset_m[VS_OUTLINE_SAMPLES];
    uint8_t found[VS_OUTLINE_SAMPLES];
};

/*
 * Where the camera sees a point of the marker, x_m ahead and y_m to the left of its
 * centre. Errors: VS_ERR_ARGUMENT if it is not in front of the camera.
 */
int vs_edges_see(const struct vs_view *view, const struct vs_marker *marker, double x_m,
                 double y_m, double pixel[2]);

/* 1 where a place is in the picture, at least border_px >= 0 away from the outer pixels. */
int vs_edges_inside(const struct vs_picture *picture, double x_px, double y_px,
                    double border_px);

/* How the picture of the marker's centre moves when it moves [px/m]. Errors: as see. */
int vs_edges_slopes(const struct vs_view *view, const struct vs_marker *marker,
                    double ahead_px[2], double left_px[2]);

/* The interpolated grey value at a place; 0 outside of the picture. */
double vs_edges_look(const struct vs_picture *picture, double x_px, double y_px);

/*
 * Reads side x side grey values row by row: those at the places between four pixels, from the
 * first towards the second in a row, and from these two towards the last two from row to row.
 * place has how far along they are, side of them in 0 .. 1.
 */
void vs_edges_grid(const struct vs_picture *picture, const double corner_px[4][2],
                   const double *place, int side, float *grey);

/* Takes the profiles that lie in the picture. Errors: as see. */
int vs_edges_take(const struct vs_outline *outline, const struct vs_view *view,
                  const struct vs_marker *marker, const struct vs_outline_pass *pass,
                  struct vs_profiles *p);

/* The middle one of count > 0 numbers, by selection; changes their order. */
float vs_edges_middle(float *v, int count);

/* Sets black and white: the medians of what the profiles begin and end with. */
void vs_edges_shades(const struct vs_profiles *p, int steps, struct vs_marker *marker);

/* An edge is at the mean place of the rises that are steep enough for one. */
void vs_edges_find(const struct vs_profiles *p, const struct vs_outline_pass *pass,
                   double unit_m, double contrast, struct vs_edges *e);

/*
 * Sets how sharp the edges are: what each gains near its place, as a mixture of an
 * edge across and one along the heading by its normal, in least squares.
 */
void vs_edges_sharpness(const struct vs_outline *outline, const struct vs_profiles *p,
                        const struct vs_edges *e, const struct vs_outline_pass *pass,
                        struct vs_marker *marker);

/* The place in levels sharpnesses, falling, of the one that is nearest to this. */
int32_t vs_edges_level(const double *sharp, int32_t levels, double sharpness);

#endif
