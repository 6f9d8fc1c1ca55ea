/* SPDX-License-Identifier: MIT */
/*
 * vs_near.h - who stands near whom, and near which box, on the floor of vs_physics.h.
 */
#ifndef VS_NEAR_H
#define VS_NEAR_H

#include "vs_physics.h"

/*
 * Makes the pairs hold for the bodies' places: body b is at positions_m[b * stride] and the
 * number behind it.
 */
void vs_near_update(struct vs_near *near, const double *positions_m, uint32_t stride);

/*
 * Distance of a point to a box's outline [m], negative inside; normal: the unit vector of
 * the way out.
 */
double vs_box_gap(const double *box_row, double x_m, double y_m, double normal[2]);

#endif
