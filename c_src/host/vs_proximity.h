/* SPDX-License-Identifier: MIT */
/*
 * vs_proximity.h - virtual rings of proximity sensors: how near the first body is along the lines
 * of each. Lengths in m, arena frame; angles in rad, counter-clockwise.
 */
#ifndef VS_PROXIMITY_H
#define VS_PROXIMITY_H

#include "vs_rays.h"
#include "vs_scene.h"

/* How a sensor responds to a distance. */
enum vs_proximity_curve {
    VS_CURVE_EPUCK,
    VS_CURVE_GENERIC,
    VS_CURVE_FOOTBOT,
    VS_CURVE_DISTANCE,
    VS_CURVE_KHEPERA
};

/* What is the same for all robots; world/sensors/proximity.py says what the curves are. */
struct vs_proximity_ring {
    uint32_t sensors;
    uint32_t rays;                     /* lines of one sensor */
    const double *places_rad;          /* [sensors] where they sit and look */
    const double *fan_rad;             /* [rays] lines, from where the sensor looks */
    const double *lines_m;             /* [sensors * 4] instead: from x, y to x, y as the robot sees
                                          them; NULL: none */
    double radius_m;                   /* where they sit: from the centre, above the floor */
    double height_m;
    double range_m;                    /* length of a line */
    double share;                      /* the curve is read at so many times the distance */
    double full;                       /* the largest reading */
    int curve;                         /* enum vs_proximity_curve */
    int blind_within;                  /* a body that a line begins in is not seen by it */
    const struct vs_obstacles *bodies; /* what is sensed; NULL: all of the scene but the robot's own */
};

/*
 * Reads the rings, struct vs_proximity_ring, of all robots: readings [robots * sensors], 0 to full.
 * Errors: as vs_rays_nearest.
 */
int vs_proximity_read(const void *proximity_ring, const struct vs_scene *scene, double *readings);

#endif
