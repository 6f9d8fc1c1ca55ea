/* SPDX-License-Identifier: MIT */
/*
 * vs_lens.h - one calibrated camera: points of the arena to pixels and back.
 * Points go through the lens model, pictures never do. Pixel (0, 0) is the middle
 * of the upper left pixel; the camera looks along its z, x to the right, y down.
 */
#ifndef VS_LENS_H
#define VS_LENS_H

#include "vs_err.h"

struct vs_lens {
    double fx_px;         /* focal length along the picture's x */
    double fy_px;         /* focal length along the picture's y */
    double cx_px;         /* principal point */
    double cy_px;
    double distortion[5]; /* k1 k2 p1 p2 k3 of OpenCV's model */
    double rotation[9];   /* arena frame to camera frame, row by row */
    double position_m[3]; /* the camera's centre in the arena frame */
};

/* Square root of a number >= 0; 0 for anything else. Needs no mathematical library. */
double vs_root(double value);

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

#endif
