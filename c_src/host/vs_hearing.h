/* SPDX-License-Identifier: MIT */
/*
 * vs_hearing.h - range and bearing: what robots say to each other, and where from. Lengths in m,
 * arena frame; angles in rad, counter-clockwise.
 */
#ifndef VS_HEARING_H
#define VS_HEARING_H

#include "vs_noticed.h"
#include "vs_random.h"
#include "vs_rays.h"
#include "vs_scene.h"
#include "vs_world.h"

#define VS_MESSAGE_MAX 16 /* [byte] */

/* What a robot says now; a length of 0: nothing. */
struct vs_message {
    uint8_t length;
    uint8_t data[VS_MESSAGE_MAX];
    double range_m; /* it is heard up to here; 0: as far as the receiver says */
};

/* Where robots' messages go. */
struct vs_speech {
    uint32_t robots;
    const int32_t *rows;         /* [robots] their numbers among all robots */
    struct vs_message *messages; /* of all robots */
    uint32_t size;               /* [byte] of the longest, 1..VS_MESSAGE_MAX */
    double range_m;              /* as in struct vs_message */
};

/* An actuator: levels [robots * (1 + size)] are the length and the bytes. speech is a
 * struct vs_speech, and nothing else is asked for. VS_OK. */
int vs_speech_set(const void *speech, const struct vs_scene *scene, const double *levels,
                  const double *growth);

/* How robots hear each other; world/sensors/range_and_bearing.py says what that is. */
struct vs_hearing {
    const struct vs_world *world; /* all robots */
    const struct vs_message *messages;
    struct vs_random *random;
    double range_m;               /* heard are those nearer than this, or than their own range, */
    double view_rad;              /* within this angle around straight ahead, */
    double height_m;              /* in lines so high above the floor; */
    int occlusions;               /* whether anything stands in the way of these */
    int speaking;                 /* who says nothing is not heard */
    uint32_t most;                /* so many messages of each robot, at least 1 */
    uint32_t size;                /* [byte] of each, 0..VS_MESSAGE_MAX */
    double loss;                  /* probability */
    double body_m;                /* radius of a body */
    int shuffled;                 /* messages come in any order, and ranges below 0 are told */
    double noise_m;               /* standard deviation of ARGoS's noise, 0: none */
    int real_range;               /* ranges are what the real board measures */
    double *places_m;             /* [all robots * 3] scratch, */
    struct vs_noticed *heard;     /* [robots * most] */
    uint32_t *counts;             /* [robots], */
    uint8_t *lines;               /* and [all robots * all robots], or NULL */
};

/*
 * A sensor: 1 + (2 + size) * most numbers, how many messages, and of each 100 times the range,
 * the bearing and the bytes; 0 where there is none. hearing is a struct vs_hearing. It draws
 * in the order of pairs. Errors: as vs_rays_blocked.
 */
int vs_hearing_read(const void *hearing, const struct vs_scene *scene, double *readings);

#endif
