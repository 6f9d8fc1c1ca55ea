/* SPDX-License-Identifier: MIT */
/*
 * vs_places.h - sensors that ask for nothing but where a robot is. Lengths in m,
 * arena frame; angles in rad, counter-clockwise.
 */
#ifndef VS_PLACES_H
#define VS_PLACES_H

#include "vs_scene.h"

/* Where robots are to go. */
struct vs_destinations {
    const double *places; /* [robots * 3] x_m, y_m, yaw_rad; x_m not a number: it is there */
};

/*
 * A sensor: five numbers, each robot's destination, and that as the robot sees it: distance, and
 * bearing in (-pi, pi], 0 where it is there; destinations is a struct vs_destinations. VS_OK.
 */
int vs_destinations_read(const void *destinations, const struct vs_scene *scene,
                         double *readings);

#endif
