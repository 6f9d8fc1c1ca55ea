/* SPDX-License-Identifier: MIT */
/*
 * vs_outline.h - the precise pose of a marker: its outline fitted to the picture
 * through the lens model. Samples along the outline look along their normals for
 * the step from black to white; position, heading and scale on the markers' plane
 * follow by robust least squares.
 */
#ifndef VS_OUTLINE_H
#define VS_OUTLINE_H

#include "vs_markers.h"

/* Checks an outline's unit, counts and passes. Errors: VS_ERR_ARGUMENT. */
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
