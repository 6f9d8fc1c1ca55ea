/* SPDX-License-Identifier: MIT */
/*
 * wander.c - drive ahead, turn away from what the ring sees, a little towards the light.
 *
 * `scripts/bench sim` runs it: it reads both rings in every step and does hardly anything, so
 * that the time which is measured is the simulator's.
 */
#include "controller.h"

#define SENSORS 8
#define SPEED_STEPS_S 400
#define NEAR_RAW 0.15 /* [1/raw] share of a proximity sensor in the turn */
#define LIGHT 20.0

struct wanderer {
    int proximity;
    int light;
};

static void init(void *state, struct vs_robot *robot)
{
    struct wanderer *s = state;

    s->proximity = vs_robot_sensor(robot, "proximity");
    s->light = vs_robot_sensor(robot, "light");
}

/* What the right half of a ring has more than its left half. */
static double difference(const double *ring)
{
    return ring[0] + ring[1] + ring[2] - ring[5] - ring[6] - ring[7];
}

static void step(void *state, struct vs_robot *robot)
{
    struct wanderer *s = state;
    double near[SENSORS], light[SENSORS];
    double turn = 0.0;

    if (vs_robot_values(robot, s->proximity, near, SENSORS) == SENSORS)
        turn += NEAR_RAW * difference(near);
    if (vs_robot_values(robot, s->light, light, SENSORS) == SENSORS)
        turn -= LIGHT * difference(light);
    vs_robot_set_wheels(robot, (int)(SPEED_STEPS_S - turn), (int)(SPEED_STEPS_S + turn));
}

const struct vs_controller vs_controller = {"wander", sizeof(struct wanderer), init, step};
