/* SPDX-License-Identifier: MIT */
/*
 * vs_view.h - a picture, and what it is of: the calibrated camera and the markers' height.
 * Pixel (0, 0) is the middle of the upper left pixel; the camera looks along its z, x to the
 * right, y down.
 */
#ifndef VS_VIEW_H
#define VS_VIEW_H

#include <stddef.h>
#include <stdint.h>

#include "../vs_err.h"

/* A grey picture: row y begins at pixels + y * stride. */
struct vs_picture {
    const uint8_t *pixels;
    size_t stride; /* [byte] at least width_px */
    int32_t width_px;
    int32_t height_px;
};

/* One calibrated camera. */
struct vs_lens {
    double fx_px, fy_px;  /* focal length along the picture's x and y */
    double cx_px, cy_px;  /* principal point */
    double distortion[5]; /* k1 k2 p1 p2 k3 of OpenCV's model */
    double rotation[9];   /* arena frame to camera frame, row by row */
    double position_m[3]; /* the camera's centre in the arena frame */
};

/* What a picture is of: the camera and the height of the markers above the floor. */
struct vs_view {
    struct vs_picture picture;
    struct vs_lens lens;
    double height_m;
};

#endif
