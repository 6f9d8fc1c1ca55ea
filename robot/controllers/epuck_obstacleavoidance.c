/* SPDX-License-Identifier: MIT */
/*
 * epuck_obstacleavoidance.c - straight on; where something is seen ahead, turn away
 * from it round the wheel that is farther off.
 *
 * ARGoS's example of this name, ported: README.md beside this folder compares the two
 * line by line. It is C and, as it stands, C++.
 *
 * Parameters: velocity in cm/s (2.5); near_raw, proximity that counts as seen (150,
 * about 4 cm): ARGoS's sensor reads 0 where nothing is near, a real one does not.
 */
#include "controller.h"

#define AHEAD_RAD 1.0 /* the four sensors that look where the robot goes */

struct avoider {
    int proximity;
    int velocity_steps_s;
    double near_raw;
};

/* A wheel's speed: ARGoS counts in cm/s, the motors in steps/s. */
static int wheel_steps_s(double cm_s)
{
    double steps_s = cm_s * VS_ROBOT_STEPS_PER_CM;

    if (steps_s > VS_ROBOT_MAX_STEPS_S)
        return VS_ROBOT_MAX_STEPS_S;
    return steps_s > -VS_ROBOT_MAX_STEPS_S ? (int)steps_s : -VS_ROBOT_MAX_STEPS_S;
}

static void init(void *state, struct vs_robot *robot)
{
    struct avoider *a = (struct avoider *)state;

    a->proximity = vs_robot_sensor(robot, "proximity");
    a->velocity_steps_s = wheel_steps_s(vs_robot_param(robot, "velocity", 2.5));
    a->near_raw = vs_robot_param(robot, "near_raw", 150.0);
}

/* The angle of the sensor ahead that sees the nearest thing, 0 if none sees any. */
static double nearest_rad(const struct avoider *a, const struct vs_robot *robot)
{
    double prox[8];
    double highest = a->near_raw;
    double angle_rad = 0.0;
    int i;

    if (vs_robot_values(robot, a->proximity, prox, 8) != 8)
        return 0.0;
    for (i = 0; i < 8; i++) {
        double here_rad = vs_robot_sensor_angle_rad[i];

        if (here_rad < -AHEAD_RAD || here_rad > AHEAD_RAD || prox[i] <= highest)
            continue;
        highest = prox[i];
        angle_rad = here_rad;
    }
    return angle_rad;
}

static void step(void *state, struct vs_robot *robot)
{
    const struct avoider *a = (const struct avoider *)state;
    double angle_rad = nearest_rad(a, robot);
    int velocity = a->velocity_steps_s;

    /* On the left: turn right, the right wheel stands. And the other way round. */
    vs_robot_set_wheels(robot, angle_rad < 0.0 ? 0 : velocity, angle_rad > 0.0 ? 0 : velocity);
}

const struct vs_controller vs_controller = {"epuck_obstacleavoidance", sizeof(struct avoider),
                                            init, step, NULL};
