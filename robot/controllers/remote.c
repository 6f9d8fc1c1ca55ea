/* SPDX-License-Identifier: MIT */
/*
 * remote.c - a robot whose controller runs on the host: it does what the host says, and says what
 * its own ring measures. See vsense/run/remote.py.
 *
 * "command", from the host: left and right wheel in steps/s, LEDs. A command that is stale stops it.
 * "own", to the host: its proximity sensors, raw, ps0..ps7.
 */
#include "controller.h"

enum { SENSORS = 8, NUMBERS = 3 };

struct remote {
    int command;
    int proximity;
    int own;
};

static void init(void *state, struct vs_robot *robot)
{
    struct remote *r = state;

    r->command = vs_robot_sensor(robot, "command");
    r->proximity = vs_robot_sensor(robot, "proximity");
    r->own = vs_robot_actuator(robot, "own");
}

static void obey(const struct remote *r, struct vs_robot *robot)
{
    double command[NUMBERS]; /* left, right, LEDs */

    if (vs_robot_values(robot, r->command, command, NUMBERS) != NUMBERS ||
        vs_robot_read(robot, r->command).stale) {
        vs_robot_set_wheels(robot, 0, 0);
        vs_robot_set_leds(robot, 0);
        return;
    }
    vs_robot_set_wheels(robot, (int)command[0], (int)command[1]);
    vs_robot_set_leds(robot, (unsigned int)command[2]);
}

static void step(void *state, struct vs_robot *robot)
{
    struct remote *r = state;
    double ring[SENSORS];
    int i;

    obey(r, robot);
    for (i = 0; i < SENSORS && vs_robot_values(robot, r->proximity, ring, SENSORS) == SENSORS; i++)
        vs_robot_actuate(robot, r->own, i, ring[i]);
}

const struct vs_controller vs_controller = {"remote", sizeof(struct remote), init, step, NULL};
