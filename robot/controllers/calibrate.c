/* SPDX-License-Identifier: MIT */
/*
 * calibrate.c - drives as the host says, and tells it what the robot's own sensors measure: for
 * `vsense robot calibrate`. Where the host's word is older than 2.5 timesteps it stands.
 *
 * The virtual sensor "wheels_wanted" has the speeds of the left and the right wheel [step/s],
 * those of the nominal robot. What the motors are told in the end telemetry has. The virtual
 * actuator "own_readings" takes what is known: 1 proximity, 2 ground, 3
 * both; then ps0..ps7 and ground left, centre, right, raw as the base measures them. The
 * parameters "proximity" and "ground" say which of the two are wanted.
 */
#include "controller.h"

#define WHEELS 2
#define RING 8
#define GROUND 3
#define GROUND_MAX 1023.0 /* what stands for white in controller.h's "ground" */

struct calibrate {
    int wanted;
    int proximity;
    int ground;
    int readings;
};

static void init(void *state, struct vs_robot *robot)
{
    struct calibrate *s = state;

    s->wanted = vs_robot_sensor(robot, "wheels_wanted");
    s->readings = s->proximity = s->ground = -1;
    if (vs_robot_param(robot, "proximity", 0.0) > 0.0)
        s->proximity = vs_robot_sensor(robot, "proximity");
    if (vs_robot_param(robot, "ground", 0.0) > 0.0)
        s->ground = vs_robot_sensor(robot, "ground");
    if (s->proximity < 0 && s->ground < 0)
        return;
    vs_robot_sense_raw(robot);
    s->readings = vs_robot_actuator(robot, "own_readings");
}

static void tell_readings(const struct calibrate *s, struct vs_robot *robot)
{
    double numbers[RING + GROUND] = {0.0};
    int known = vs_robot_values(robot, s->proximity, numbers, RING) == RING;
    int i;

    if (vs_robot_values(robot, s->ground, numbers + RING, GROUND) == GROUND)
        known |= 2;
    vs_robot_actuate(robot, s->readings, 0, known);
    for (i = 0; i < RING; i++)
        vs_robot_actuate(robot, s->readings, 1 + i, numbers[i]);
    for (; i < RING + GROUND; i++)
        vs_robot_actuate(robot, s->readings, 1 + i, numbers[i] * GROUND_MAX + 0.5);
}

static void step(void *state, struct vs_robot *robot)
{
    const struct calibrate *s = state;
    double wanted[WHEELS] = {0.0, 0.0};

    if (vs_robot_read(robot, s->wanted).stale ||
        vs_robot_values(robot, s->wanted, wanted, WHEELS) != WHEELS)
        wanted[0] = wanted[1] = 0.0;
    vs_robot_set_wheels(robot, (int)wanted[0], (int)wanted[1]);
    if (s->readings >= 0)
        tell_readings(s, robot);
}

const struct vs_controller vs_controller = {"calibrate", sizeof(struct calibrate), init, step,
                                            NULL};
