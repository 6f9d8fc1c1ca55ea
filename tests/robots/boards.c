/* SPDX-License-Identifier: MIT */
/* A controller that shows on its LEDs what the boards beside the base measure, and talks. */
#include "controller.h"

struct talker {
    int ground;
    int rab;
    int wheels;
    int acceleration;
    int microphones;
    int gyroscope;
    int message;
    unsigned int heard; /* messages so far */
};

static void init(void *state, struct vs_robot *robot)
{
    struct talker *talker = state;

    talker->ground = vs_robot_sensor(robot, "ground");
    talker->rab = vs_robot_sensor(robot, "range_and_bearing");
    talker->wheels = vs_robot_sensor(robot, "wheels");
    talker->acceleration = vs_robot_sensor(robot, "accelerometer");
    talker->microphones = vs_robot_sensor(robot, "microphones");
    talker->gyroscope = vs_robot_sensor(robot, "gyroscope");
    talker->message = vs_robot_actuator(robot, "message");
}

/* LED 0: it is bright on the left; 1: the wheels have turned; 2: the newest message came
 * from the right; 3 and more: how many messages were heard. The body: it feels gravity and
 * hears the same with three microphones. The front: it rolls over. IRIDIA's back LED shows a
 * colour. */
static void step(void *state, struct vs_robot *robot)
{
    struct talker *talker = state;
    double ground[3] = {0};
    double heard[31] = {0};
    double ways_cm[2] = {0};
    double g[3] = {0};
    double sounds[4] = {0};
    double rates[3] = {0};
    unsigned int leds = 0;

    if (vs_robot_values(robot, talker->ground, ground, 3) == 3 && ground[0] > 0.5)
        leds |= 1;
    if (vs_robot_values(robot, talker->wheels, ways_cm, 2) == 2 && ways_cm[0] > 1.0)
        leds |= 2;
    if (vs_robot_values(robot, talker->rab, heard, 31) == 31)
        talker->heard += (unsigned int)heard[0];
    if (heard[0] > 0.0 && heard[2] < 0.0)
        leds |= 4;
    if (vs_robot_values(robot, talker->acceleration, g, 3) == 3 && g[2] - g[0] == 800 &&
        vs_robot_values(robot, talker->microphones, sounds, 4) == 3 && sounds[0] == sounds[2])
        leds |= VS_ROBOT_LED_BODY;
    if (vs_robot_values(robot, talker->gyroscope, rates, 3) == 3 && rates[0] > 1.0)
        leds |= VS_ROBOT_LED_FRONT;
    if (vs_robot_rgb_leds(robot) == 3)
        vs_robot_set_rgb(robot, 2, leds & VS_ROBOT_LED_FRONT ? 255 : 1, 2, 3);
    vs_robot_set_leds(robot, leds | talker->heard << 3);
    vs_robot_actuate(robot, talker->message, 0, 2);
    vs_robot_actuate(robot, talker->message, 1, talker->heard);
    vs_robot_actuate(robot, talker->message, 2, 0xAB);
    vs_robot_set_wheels(robot, 300, 300);
}

const struct vs_controller vs_controller = {"boards", sizeof(struct talker), init, step, NULL};
