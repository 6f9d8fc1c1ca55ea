/* SPDX-License-Identifier: MIT */
/*
 * start.c - wander; on a green floor stop with a probability at every timestep, light
 * the red LEDs, and stay for as long as the floor is green.
 *
 * Parameters: stop_probability per timestep (0.3), and those of walk.h.
 */
#include "controller.h"

struct wanderer {
    int floor;
    double stop_probability;
    int resting;
    struct vs_walk walk;
};

/* A stale value is no news: a robot that rests goes on. */
static int on_green(const struct wanderer *s, const struct vs_robot *robot)
{
    double color[4]; /* red, green, blue, alpha: 0 to 255 */

    if (vs_robot_values(robot, s->floor, color, 4) != 4)
        return 0; /* not known yet */
    if (vs_robot_read(robot, s->floor).stale)
        return s->resting;
    return color[0] < 100.0 && color[1] > 200.0 && color[2] < 100.0;
}

/* Begins a run: all of *state is 0. */
static void init(void *state, struct vs_robot *robot)
{
    struct wanderer *s = state;

    s->floor = vs_robot_sensor(robot, "rgb_ground");
    s->stop_probability = vs_robot_param_in(robot, "stop_probability", 0.3, 0, 1);
    vs_walk_init(&s->walk, robot);
}

/* One control step, ten times a second. */
static void step(void *state, struct vs_robot *robot)
{
    struct wanderer *s = state;
    int green = on_green(s, robot);

    if (green && !s->resting && vs_robot_random(robot) < s->stop_probability)
        s->resting = 1;
    s->resting = s->resting && green;
    vs_robot_set_leds(robot, s->resting ? VS_ROBOT_LED_RING : 0);
    if (s->resting)
        vs_walk_rest(&s->walk, robot);
    else
        vs_walk_wander(&s->walk, robot);
}

const struct vs_controller vs_controller = {"start", sizeof(struct wanderer), init, step, NULL};
