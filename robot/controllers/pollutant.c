/* SPDX-License-Identifier: MIT */
/*
 * pollutant.c - the robots of the thesis's chapter 5: wander through the arena;
 * where the pollutant is sensed, stop with a probability at every timestep and
 * light the red LEDs, as if cleaning; go on when it has gone.
 *
 * Parameters: stop_probability per timestep (0.3), and those of walk.h.
 */
#include "controller.h"

struct cleaner {
    int pollutant;
    double stop_probability;
    int cleaning;
    struct vs_walk walk;
};

/* A stale value is no news: whoever cleans goes on until told that the pollutant has
 * gone, and nobody else begins. A bad moment of the network must not scatter a swarm. */
static int senses_pollutant(const struct cleaner *s, const struct vs_robot *robot)
{
    struct vs_reading reading = vs_robot_read(robot, s->pollutant);

    if (reading.known && reading.stale)
        return s->cleaning;
    return reading.known && reading.value >= 0.5;
}

static void init(void *state, struct vs_robot *robot)
{
    struct cleaner *s = state;

    s->pollutant = vs_robot_sensor(robot, "pollutant");
    s->stop_probability = vs_robot_param_in(robot, "stop_probability", 0.3, 0, 1);
    vs_walk_init(&s->walk, robot);
}

static void step(void *state, struct vs_robot *robot)
{
    struct cleaner *s = state;
    int sensed = senses_pollutant(s, robot);

    if (sensed && !s->cleaning && vs_robot_random(robot) < s->stop_probability)
        s->cleaning = 1;
    s->cleaning = s->cleaning && sensed;
    vs_robot_set_leds(robot, s->cleaning ? VS_ROBOT_LED_RING : 0);
    if (s->cleaning)
        vs_walk_rest(&s->walk, robot);
    else
        vs_walk_wander(&s->walk, robot);
}

const struct vs_controller vs_controller = {"pollutant", sizeof(struct cleaner), init, step, NULL};
