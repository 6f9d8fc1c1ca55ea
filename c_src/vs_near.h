/* SPDX-License-Identifier: MIT */
/*
 * vs_near.h - who stands near whom on the arena's floor: the pairs of a robot and a body
 * or a box that can touch or be felt. They are searched for again only when somebody has
 * moved far enough to matter, so most ticks pay nothing for them. The arena frame, in m.
 */
#ifndef VS_NEAR_H
#define VS_NEAR_H

#include <stdint.h>

#define VS_BOX_NUMBERS 6 /* of one box: x_m, y_m, cosine and sine of its yaw, half its sizes */

/* A robot, and what is near it: a body (other < bodies) or box other - bodies. */
struct vs_pair {
    uint32_t robot;
    uint32_t other;
};

/* All arrays are the caller's. Bodies are discs, the first ones robots. */
struct vs_near {
    uint32_t robots;        /* bodies that feel and give way */
    uint32_t bodies;
    uint32_t boxes;
    const double *radii_m;  /* [bodies] */
    const double *box_rows; /* [boxes * VS_BOX_NUMBERS] */
    double *searched_m;     /* [bodies * 2] where everybody was at the last search */
    struct vs_pair *pairs;  /* [robots * (bodies + boxes)]: by robot, then by other */
    uint32_t count;         /* pairs in use */
    uint32_t searches;      /* done so far; set it to 0 to have the pairs searched anew */
};

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

/* vs_box_gap for n points [n * 2] and the boxes' rows given by number; normals [n * 2]. */
void vs_box_gaps(const double *box_rows, const uint32_t *box, const double *points_m,
                 uint32_t n, double *gaps_m, double *normals);

#endif
