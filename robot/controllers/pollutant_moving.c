/* SPDX-License-Identifier: MIT */
/*
 * pollutant_moving.c - cleaners as in pollutant.c, and a polluter that is a robot, too:
 * the one that is given a destination drives there, slowly and with its body lit, and
 * cleans nothing. All run this program; only the virtual sensors tell them apart.
 *
 * A cleaner that the cone has left behind drives on as it came: that is into the cone.
 *
 * Parameters: stop_probability per timestep (0.3), polluter_cm_s (2), and those of
 * walk.h.
 */
#include "controller.h"

#define ARRIVED_M 0.001 /* whoever has no destination is told its own place */

struct mover {
    int pollutant;
    int destination;
    double stop_probability;
    double cleaner_steps_s;
    double polluter_steps_s;
    int cleaning;
    struct vs_walk walk;
};

/* Whether to clean in this step. What is not known is stale, and a stale value is no news. */
static int cleans(const struct mover *s, struct vs_robot *robot)
{
    struct vs_reading reading = vs_robot_read(robot, s->pollutant);

    if (reading.stale)
        return s->cleaning;
    return reading.value >= 0.5 && (s->cleaning || vs_robot_random(robot) < s->stop_probability);
}

static void init(void *state, struct vs_robot *robot)
{
    struct mover *s = state;

    s->pollutant = vs_robot_sensor(robot, "pollutant");
    s->destination = vs_robot_sensor(robot, "destination");
    s->stop_probability = vs_robot_param_in(robot, "stop_probability", 0.3, 0, 1);
    s->polluter_steps_s =
        vs_robot_param_in(robot, "polluter_cm_s", 2.0, 0, INT_MAX) * VS_ROBOT_STEPS_PER_CM;
    vs_walk_init(&s->walk, robot);
    s->cleaner_steps_s = s->walk.speed_steps_s;
}

/* Slowly, but for a way round somebody: that is walk.h's, in seconds. */
static void pollute(struct mover *s, struct vs_robot *robot, double bearing_rad)
{
    int free = s->walk.activity == VS_WALK_STEER;

    s->cleaning = 0;
    s->walk.speed_steps_s = free ? s->polluter_steps_s : s->cleaner_steps_s;
    vs_robot_set_leds(robot, VS_ROBOT_LED_BODY);
    vs_walk_towards(&s->walk, robot, bearing_rad);
}

static void clean(struct mover *s, struct vs_robot *robot)
{
    s->cleaning = cleans(s, robot);
    s->walk.speed_steps_s = s->cleaner_steps_s;
    vs_robot_set_leds(robot, s->cleaning ? VS_ROBOT_LED_RING : 0);
    if (s->cleaning)
        vs_walk_rest(&s->walk, robot);
    else
        vs_walk_wander(&s->walk, robot);
}

static void step(void *state, struct vs_robot *robot)
{
    struct mover *s = state;
    double goal[5]; /* x, y, heading, distance [m], bearing [rad] */

    if (vs_robot_values(robot, s->destination, goal, 5) == 5 && goal[3] > ARRIVED_M)
        pollute(s, robot, goal[4]);
    else
        clean(s, robot);
}

const struct vs_controller vs_controller = {"pollutant_moving", sizeof(struct mover), init,
                                            step, NULL};
