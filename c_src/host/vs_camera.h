/* SPDX-License-Identifier: MIT */
/*
 * vs_camera.h - single LEDs of robots and things, and omnidirectional cameras that see them.
 * Lengths in m, arena frame; angles in rad, counter-clockwise.
 */
#ifndef VS_CAMERA_H
#define VS_CAMERA_H

#include "vs_noticed.h"
#include "vs_random.h"
#include "vs_rays.h"
#include "vs_scene.h"
#include "vs_world.h"

/* LEDs of robots that one actuator sets. */
struct vs_lamps {
    uint32_t robots;
    const int32_t *rows; /* [robots] their numbers among all robots */
    uint8_t *colors;     /* [all robots * leds * 3] red, green, blue of each LED */
    uint8_t *shown;      /* [all robots * 3] and the largest of a robot's, of each colour */
    uint32_t leds;       /* that a robot has */
    uint32_t first;      /* the actuator's are those from here on, */
    uint32_t count;      /* so many */
    int switches;        /* they are red or off */
};

/* An actuator: levels [robots * count * 3] are the colours; of switches [robots * count], the last
 * LED's first, what is not 0 is on. lamps is a struct vs_lamps, and nothing else is asked for. VS_OK. */
int vs_lamps_light(const void *lamps, const struct vs_scene *scene, const double *levels,
                   const double *growth);

/* An LED that may be lit. */
struct vs_lit {
    double at_m[3];
    int32_t robot;        /* whose it is; -1: a thing's */
    uint32_t together;    /* so many LEDs, from this one on, are on the same robot; of a thing 1 */
    const uint8_t *color; /* red, green, blue */
};

/* What cameras see; world/sensors/omnidirectional_camera.py says how. */
struct vs_camera {
    const struct vs_world *world; /* all robots */
    const uint8_t *colors;        /* as in struct vs_lamps */
    uint32_t leds;
    uint32_t still;               /* LEDs of things */
    const double *leds_m;         /* [all robots * leds * 3] where they are, in a robot's frame */
    double apart_m;               /* no two LEDs of a robot are farther from each other */
    struct vs_random *random;
    double height_m;              /* of the camera; LEDs at twice this height are too high */
    double reach_m;               /* it sees those nearer than this, */
    double reach2_m2;             /* squared, */
    int square;                   /* or those in the square of this half side */
    double noise;                 /* standard deviation of a shift; of a square a share */
    uint32_t most;                /* the nearest so many, at least 1 */
    uint32_t room;                /* in seen */
    struct vs_lit *lit;           /* [still + all robots * leds] things' LEDs, then scratch */
    struct vs_noticed *seen;      /* [room] scratch: all LEDs for one robot, with noise for each */
    struct vs_noticed *nearest;   /* [most] */
    uint32_t *counts;             /* and [robots] */
};

/*
 * A sensor: 1 + 5 * most numbers, how many LEDs, and of each, the nearest first, 100 times the
 * distance along the floor, the bearing, red, green and blue; 0 where there is none. camera
 * is a struct vs_camera. Noise is drawn when all robots have looked, in their order. Errors:
 * VS_ERR_SPACE for too little room, and as vs_rays_blocked.
 */
int vs_camera_read(const void *camera, const struct vs_scene *scene, double *readings);

#endif
