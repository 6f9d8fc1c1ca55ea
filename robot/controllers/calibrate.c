/* SPDX-License-Identifier: MIT */
/*
 * calibrate.c - drives as the host says, and shows what its sensors read: for `vsense robot
 * calibrate`. Where the host's word is older than 2.5 timesteps it stands.
 *
 * The virtual sensor "wheels_wanted" has the speeds of the left and the right wheel [step/s],
 * those of the nominal robot. What robot and board measure is shown as the numbers ps0..ps7,
 * gs0..gs2 (raw, as the settings have them before any calibration) and way_l, way_r [cm].
 */
#include "controller.h"

#define RING 8
#define GROUND 3
#define WHEELS 2

struct calibrate {
    int wanted;
    int proximity;
    int ground;
    int wheels;
};

static void init(void *state, struct vs_robot *robot)
{
    struct calibrate *s = state;

    s->wanted = vs_robot_sensor(robot, "wheels_wanted");
    s->proximity = vs_robot_sensor(robot, "proximity");
    s->ground = vs_robot_sensor(robot, "ground");
    s->wheels = vs_robot_sensor(robot, "wheels");
}

static void show(struct vs_robot *robot, int sensor, const char *const *names, int count)
{
    double values[RING];
    int i;

    if (vs_robot_values(robot, sensor, values, count) == count)
        for (i = 0; i < count; i++)
            vs_robot_show(robot, names[i], values[i]);
}

static void step(void *state, struct vs_robot *robot)
{
    static const char *const ring[RING] = {"ps0", "ps1", "ps2", "ps3", "ps4", "ps5", "ps6", "ps7"};
    static const char *const ground[GROUND] = {"gs0", "gs1", "gs2"};
    static const char *const ways[WHEELS] = {"way_l", "way_r"};
    const struct calibrate *s = state;
    double wanted[WHEELS] = {0.0, 0.0};

    if (vs_robot_read(robot, s->wanted).stale ||
        vs_robot_values(robot, s->wanted, wanted, WHEELS) != WHEELS)
        wanted[0] = wanted[1] = 0.0;
    vs_robot_set_wheels(robot, (int)wanted[0], (int)wanted[1]);
    show(robot, s->proximity, ring, RING);
    show(robot, s->ground, ground, GROUND);
    show(robot, s->wheels, ways, WHEELS);
}

const struct vs_controller vs_controller = {"calibrate", sizeof(struct calibrate), init, step,
                                            NULL};
