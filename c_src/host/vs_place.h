/* SPDX-License-Identifier: MIT */
/* vs_place.h - what C alone asks of a scene: where a robot is, and what actuators report. */
#ifndef VS_PLACE_H
#define VS_PLACE_H

#include <string.h>

#include "vs_scene.h"

struct vs_place {
    double x_m;
    double y_m;
    double yaw_rad;
};

static inline struct vs_place vs_place_of(const struct vs_scene *scene, uint32_t robot)
{
    struct vs_place place;

    memcpy(&place, scene->first + robot * scene->stride, sizeof place);
    return place;
}

/* Takes the newest reports. */
void vs_heard_renew(const struct vs_heard *heard);

#endif
