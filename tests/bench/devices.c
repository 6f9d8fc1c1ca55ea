/* SPDX-License-Identifier: MIT */
/*
 * devices.c - drive ahead, turn away from what the ring sees, and as all other devices say.
 *
 * `scripts/bench sim` runs it: it reads and sets in every step what published e-pucks have, and
 * does hardly anything else, so that the time which is measured is the simulator's.
 */
#include "controller.h"

#define MOST 128 /* numbers of a sensor */
#define SPEED_STEPS_S 400
#define NEAR_RAW 0.15 /* [1/raw] share of a proximity sensor in the turn */
#define OTHERS 4
#define LEDS 9        /* red, green and blue of three */

struct driver {
    int proximity;
    int others[OTHERS];
    int message;
    int leds;
    int steps;
    double sum;
};

static void init(void *state, struct vs_robot *robot)
{
    static const char *const names[OTHERS] = {"light", "ground", "range_and_bearing",
                                              "omnidirectional_camera"};
    struct driver *s = state;
    int i;

    s->proximity = vs_robot_sensor(robot, "proximity");
    for (i = 0; i < OTHERS; i++)
        s->others[i] = vs_robot_sensor(robot, names[i]);
    s->message = vs_robot_actuator(robot, "message");
    s->leds = vs_robot_actuator(robot, "rgb_leds");
}

static void say(struct driver *s, struct vs_robot *robot)
{
    int i;

    vs_robot_actuate(robot, s->message, 0, 1.0);
    vs_robot_actuate(robot, s->message, 1, s->steps % 200);
    for (i = 0; i < LEDS; i++)
        vs_robot_actuate(robot, s->leds, i, 200.0 + i);
    s->steps++;
}

static void step(void *state, struct vs_robot *robot)
{
    struct driver *s = state;
    double values[MOST], turn;
    int i;

    for (i = 0; i < OTHERS; i++)
        if (vs_robot_values(robot, s->others[i], values, MOST) > 1)
            s->sum += values[1];
    s->sum -= 100.0 * (int)(s->sum / 100.0);
    turn = s->sum;
    if (vs_robot_values(robot, s->proximity, values, MOST) == 8)
        turn += NEAR_RAW * (values[0] + values[1] + values[2] - values[5] - values[6] - values[7]);
    say(s, robot);
    vs_robot_set_wheels(robot, (int)(SPEED_STEPS_S - turn), (int)(SPEED_STEPS_S + turn));
}

const struct vs_controller vs_controller = {"devices", sizeof(struct driver), init, step};
