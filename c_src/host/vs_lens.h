/* SPDX-License-Identifier: MIT */
/* vs_lens.h - points of the arena to pixels of a camera and back. */
#ifndef VS_LENS_H
#define VS_LENS_H

#include "vs_view.h"

/*
 * Where the camera sees a point of the arena. Errors: VS_ERR_ARGUMENT if the point
 * is not in front of the camera.
 */
int vs_lens_project(const struct vs_lens *lens, const double point_m[3], double pixel[2]);

/*
 * Which point (x, y) of the horizontal plane at height_m the camera sees at a
 * pixel. Errors: VS_ERR_ARGUMENT if it sees none there.
 */
int vs_lens_to_plane(const struct vs_lens *lens, const double pixel[2], double height_m,
                     double point_m[2]);

/*
 * The place on the markers' plane that a view shows at a pixel, and how it moves with the pixel, a
 * matrix row by row [m/px]. Returns 0 where it shows none, else 1.
 */
int vs_lens_map(const struct vs_view *view, double x_px, double y_px, double place_m[2],
                double map[4]);

#endif
