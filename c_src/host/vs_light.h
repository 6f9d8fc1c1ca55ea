/* SPDX-License-Identifier: MIT */
/*
 * vs_light.h - rings of light sensors around robots, among lights and what stands in their
 * way. Lengths in m, arena frame; angles in rad, counter-clockwise.
 */
#ifndef VS_LIGHT_H
#define VS_LIGHT_H

#include "vs_rays.h"
#include "vs_scene.h"

#define VS_LIGHT_SENSORS_MAX 64 /* of a ring */
#define VS_LIGHT_AT_SENSORS 0   /* (intensity / distance)^2 from each sensor: thesis 4.2.2 */
#define VS_LIGHT_AT_CENTRE 1    /* ARGoS's epuck_light: from the robot's centre on the floor */

/* What is the same for all robots; world/sensors/light.py says what the formulas are. */
struct vs_light_ring {
    uint32_t formula;         /* VS_LIGHT_AT_SENSORS or VS_LIGHT_AT_CENTRE */
    uint32_t sensors;         /* 1..VS_LIGHT_SENSORS_MAX */
    const double *angles_rad; /* [sensors] where they look, from straight ahead, in (-pi, pi] */
    double radius_m;          /* where they sit: from the centre, above the floor */
    double height_m;
    double nearest_m;         /* closer than this (intensity / distance)^2 grows no more */
    double range_m;           /* lights farther away are not sensed */
    double view_rad;          /* nor those farther off a sensor's axis than half of this */
    double most;              /* no sum is larger; may be infinity */
    double gain;              /* readings are multiplied by it in the end */
    int occlusions;           /* whether anything stands in the way */
    size_t step;              /* from a robot's readings to the next one's, >= sensors */
};

/*
 * Reads the rings, struct vs_light_ring, of all robots: readings[i * step + k] is sensor k of robot i. A robot's
 * own body stands in the way of its sensors, not of its centre. Errors: as vs_rays_blocked.
 */
int vs_light_read(const void *light_ring, const struct vs_scene *scene, double *readings);

#endif
