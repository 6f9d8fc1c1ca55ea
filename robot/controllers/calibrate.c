/* SPDX-License-Identifier: MIT */
/*
 * calibrate.c - drives as the host says: for `vsense robot calibrate`. Where the host's word is
 * older than 2.5 timesteps it stands.
 *
 * The virtual sensor "wheels_wanted" has the speeds of the left and the right wheel [step/s],
 * those of the nominal robot. What the motors are told in the end telemetry has.
 */
#include "controller.h"

#define WHEELS 2

struct calibrate {
    int wanted;
};

static void init(void *state, struct vs_robot *robot)
{
    struct calibrate *s = state;

    s->wanted = vs_robot_sensor(robot, "wheels_wanted");
}

static void step(void *state, struct vs_robot *robot)
{
    const struct calibrate *s = state;
    double wanted[WHEELS] = {0.0, 0.0};

    if (vs_robot_read(robot, s->wanted).stale ||
        vs_robot_values(robot, s->wanted, wanted, WHEELS) != WHEELS)
        wanted[0] = wanted[1] = 0.0;
    vs_robot_set_wheels(robot, (int)wanted[0], (int)wanted[1]);
}

const struct vs_controller vs_controller = {"calibrate", sizeof(struct calibrate), init, step,
                                            NULL};
