/* SPDX-License-Identifier: MIT */
/*
 * aggregation.c - wander; on a floor of the wanted colour stop with a probability at
 * every timestep, stay for as long as the floor has it, and shine: whoever sees robots
 * shine drives to the farthest of them, through the gaps between the others.
 *
 * Shining are the virtual LEDs, which the others see, and the real red ones.
 *
 * Parameters: red, green, blue of the wanted colour (0, 255, 0), tolerance, by how much
 * each of them may differ (60), stop_probability per timestep (0.06), and those of walk.h.
 */
#include "controller.h"

#define PLACES 6 /* robots that the sensor "leds" tells of, at most */
#define SHINE 255.0

struct gatherer {
    int floor;
    int others;
    int lamp;
    double wanted[3];
    double tolerance;
    double stop_probability;
    int resting;
    struct vs_walk walk;
};

/* A stale value is no news: whoever rests goes on resting. */
static int on_spot(const struct gatherer *s, const struct vs_robot *robot)
{
    double color[4]; /* red, green, blue, alpha */
    int i;

    if (vs_robot_values(robot, s->floor, color, 4) != 4)
        return 0;
    if (vs_robot_read(robot, s->floor).stale)
        return s->resting;
    for (i = 0; i < 3; i++) {
        double off = color[i] - s->wanted[i];

        if (off > s->tolerance || off < -s->tolerance)
            return 0;
    }
    return 1;
}

/* Where the farthest shining robot is, counter-clockwise from straight ahead; 0 if none
 * is in sight. */
static int see_shining(const struct gatherer *s, const struct vs_robot *robot, double *bearing_rad)
{
    double seen[1 + 5 * PLACES]; /* how many; distance, bearing, red, green, blue of each */
    int size = vs_robot_values(robot, s->others, seen, 1 + 5 * PLACES);
    int count = size > 0 ? (int)seen[0] : 0;

    if (count < 1 || size < 1 + 5 * count || vs_robot_read(robot, s->others).stale)
        return 0;
    *bearing_rad = seen[1 + 5 * (count - 1) + 1];
    return 1;
}

static void init(void *state, struct vs_robot *robot)
{
    struct gatherer *s = state;

    s->floor = vs_robot_sensor(robot, "rgb_ground");
    s->others = vs_robot_sensor(robot, "leds");
    s->lamp = vs_robot_actuator(robot, "led_color");
    s->wanted[0] = vs_robot_param_in(robot, "red", 0.0, 0, 255);
    s->wanted[1] = vs_robot_param_in(robot, "green", 255.0, 0, 255);
    s->wanted[2] = vs_robot_param_in(robot, "blue", 0.0, 0, 255);
    s->tolerance = vs_robot_param_in(robot, "tolerance", 60.0, 0, INT_MAX);
    s->stop_probability = vs_robot_param_in(robot, "stop_probability", 0.06, 0, 1);
    vs_walk_init(&s->walk, robot);
}

static void step(void *state, struct vs_robot *robot)
{
    struct gatherer *s = state;
    int there = on_spot(s, robot);
    double bearing_rad = 0.0;

    if (there && !s->resting && vs_robot_random(robot) < s->stop_probability)
        s->resting = 1;
    s->resting = s->resting && there;
    vs_robot_set_leds(robot, s->resting ? VS_ROBOT_LED_RING : 0);
    vs_robot_actuate(robot, s->lamp, 0, s->resting ? SHINE : 0.0);
    if (s->resting)
        vs_walk_rest(&s->walk, robot);
    else if (see_shining(s, robot, &bearing_rad))
        vs_walk_towards(&s->walk, robot, bearing_rad);
    else
        vs_walk_wander(&s->walk, robot);
}

const struct vs_controller vs_controller = {"aggregation", sizeof(struct gatherer), init, step,
                                            NULL};
