/* SPDX-License-Identifier: MIT */
/*
 * pollutant_cleaning.c - wander; where the pollutant is sensed, clean it, drive slowly
 * so as to stay a while, and light the red LEDs.
 *
 * Parameters: cleaning_cm_s, the speed of a robot that cleans (1), and those of walk.h.
 */
#include "controller.h"

struct cleaner {
    int pollutant;
    int brush;
    double wandering_steps_s;
    double cleaning_steps_s;
    struct vs_walk walk;
};

static void init(void *state, struct vs_robot *robot)
{
    struct cleaner *s = state;

    s->pollutant = vs_robot_sensor(robot, "pollutant");
    s->brush = vs_robot_actuator(robot, "cleaning");
    s->cleaning_steps_s =
        vs_robot_param_in(robot, "cleaning_cm_s", 1.0, 0, INT_MAX) * VS_ROBOT_STEPS_PER_CM;
    vs_walk_init(&s->walk, robot);
    s->wandering_steps_s = s->walk.speed_steps_s;
}

/* A stale value counts as it is: to clean where nothing is left does no harm. */
static void step(void *state, struct vs_robot *robot)
{
    struct cleaner *s = state;
    int dirty = vs_robot_read(robot, s->pollutant).value >= 0.5;

    vs_robot_actuate(robot, s->brush, 0, dirty ? 1.0 : 0.0);
    vs_robot_set_leds(robot, dirty ? VS_ROBOT_LED_RING : 0);
    s->walk.speed_steps_s = dirty ? s->cleaning_steps_s : s->wandering_steps_s;
    vs_walk_wander(&s->walk, robot);
}

const struct vs_controller vs_controller = {"pollutant_cleaning", sizeof(struct cleaner),
                                            init, step, NULL};
