/* SPDX-License-Identifier: MIT */
/*
 * vs_leds.h - the coloured lights of robots: how they are shown, and how others see them. Lengths
 * in m, arena frame; angles in rad, counter-clockwise.
 */
#ifndef VS_LEDS_H
#define VS_LEDS_H

#include "vs_world.h"
#include "vs_scene.h"

#define VS_LEDS_MOST 32 /* lights in a reading */

/* The colours that robots show. */
struct vs_shine {
    uint32_t robots;
    const int32_t *rows; /* [robots] their numbers among all robots */
    uint8_t *colors;     /* [all robots * 3] red, green, blue */
};

/* An actuator: levels [robots * 3] are the colours, 0..255 each. shine is a struct vs_shine, and
 * nothing else is asked for. VS_OK. */
int vs_shine_show(const void *shine, const struct vs_scene *scene, const double *levels,
                  const double *growth);

/* What robots see of the lights of others; world/sensors/leds.py says how. */
struct vs_leds {
    const struct vs_world *world; /* all robots */
    const uint8_t *colors;        /* as in struct vs_shine; 0, 0, 0: it is dark */
    double range_m;               /* seen are those nearer than this, */
    double view_rad;              /* within this angle around straight ahead, */
    double height_m;              /* in lines so high above the floor; */
    int occlusions;               /* whether anything stands in the way of these */
    uint32_t most;                /* the nearest 1..VS_LEDS_MOST */
};

/*
 * A sensor: 1 + 5 * most numbers, how many lights there are, and of each, the nearest first, 100
 * times the distance, bearing in [-pi, pi], red, green and blue; 0 where there is none. leds is
 * a struct vs_leds. Errors: VS_ERR_ARGUMENT for another number of lights, and as vs_rays_blocked.
 */
int vs_leds_read(const void *leds, const struct vs_scene *scene, double *readings);

#endif
