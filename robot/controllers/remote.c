/* SPDX-License-Identifier: MIT */
/*
 * remote.c - a robot whose controller runs on the host: it does what the host says, and says what
 * its own sensors measure. See vsense/run/remote.py.
 *
 * "command", from the host: left and right wheel in steps/s, LEDs, red, green and blue of four
 * coloured LEDs, and "message": its length and 4 bytes. A command that is stale stops it.
 * "own", to the host: of each sensor how many numbers are known, and room for its numbers.
 */
#include "controller.h"

enum { RGB = 4, MESSAGE = 5, NUMBERS = 3 + 3 * RGB + MESSAGE, MOST = 31 };

static const struct {
    const char *name;
    int room;
} own[] = {{"proximity", 8}, {"light", 8}, {"battery_low", 1}, {"ground", 3}, {"wheels", 2},
           {"range_and_bearing", MOST}, {"accelerometer", 3}, {"microphones", 4}, {"battery", 1},
           {"gyroscope", 3}, {"distance", 1}};

#define SENSORS ((int)(sizeof own / sizeof own[0]))

struct remote {
    int command;
    int own;
    int message; /* -1: it has no board to say it with */
    int sensors[sizeof own / sizeof own[0]];
};

static void init(void *state, struct vs_robot *robot)
{
    struct remote *r = state;
    int i;

    r->command = vs_robot_sensor(robot, "command");
    r->own = vs_robot_actuator(robot, "own");
    r->message = -1;
    if (vs_robot_offers(robot, "range_and_bearing"))
        r->message = vs_robot_actuator(robot, "message");
    for (i = 0; i < SENSORS; i++)
        r->sensors[i] = vs_robot_offers(robot, own[i].name) ? vs_robot_sensor(robot, own[i].name)
                                                            : -1;
}

static void obey(const struct remote *r, struct vs_robot *robot)
{
    double command[NUMBERS] = {0};
    int fresh = vs_robot_values(robot, r->command, command, NUMBERS) == NUMBERS &&
                !vs_robot_read(robot, r->command).stale;
    const double *rgb = command + 3;
    const double *message = rgb + 3 * RGB;
    int i;

    for (i = 0; i < NUMBERS && !fresh; i++)
        command[i] = 0.0;
    vs_robot_set_wheels(robot, (int)command[0], (int)command[1]);
    vs_robot_set_leds(robot, (unsigned int)command[2]);
    for (i = 0; i < RGB; i++)
        vs_robot_set_rgb(robot, i, (int)rgb[3 * i], (int)rgb[3 * i + 1], (int)rgb[3 * i + 2]);
    for (i = 0; i < MESSAGE; i++)
        vs_robot_actuate(robot, r->message, i, message[i]);
}

static void tell(const struct remote *r, struct vs_robot *robot)
{
    int at = 0;
    int i, n;

    for (i = 0; i < SENSORS; i++) {
        double values[MOST] = {0};
        int known = vs_robot_values(robot, r->sensors[i], values, own[i].room);

        vs_robot_actuate(robot, r->own, at++, known < own[i].room ? known : own[i].room);
        for (n = 0; n < own[i].room; n++)
            vs_robot_actuate(robot, r->own, at++, values[n]);
    }
}

static void step(void *state, struct vs_robot *robot)
{
    obey(state, robot);
    tell(state, robot);
}

const struct vs_controller vs_controller = {"remote", sizeof(struct remote), init, step, NULL};
