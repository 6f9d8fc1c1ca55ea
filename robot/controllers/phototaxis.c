/* SPDX-License-Identifier: MIT */
/*
 * phototaxis.c - drive to where it is bright; rest where it is bright enough, with the
 * red LEDs lit; wander in the dark.
 *
 * Only the ring's brightnesses are used, ps0..ps7: the same program follows a real
 * light with the robot's own "light", which counts the same way.
 *
 * Parameters: enough, brightness to rest in (8); least, difference within the ring that
 * tells a direction (0.02); and those of walk.h.
 */
#include "controller.h"

#define SENSORS 8
#define PI 3.14159265358979

struct moth {
    int light;
    double enough;
    double least;
    int resting;
    struct vs_walk walk;
};

struct ring {
    double value[SENSORS];
    int brightest;
    int darkest;
};

/* Reads the ring; 0 if it is not known. */
static int look(const struct moth *s, const struct vs_robot *robot, struct ring *ring)
{
    int i;

    ring->brightest = ring->darkest = 0;
    if (vs_robot_values(robot, s->light, ring->value, SENSORS) < SENSORS)
        return 0;
    for (i = 1; i < SENSORS; i++) {
        if (ring->value[i] > ring->value[ring->brightest])
            ring->brightest = i;
        if (ring->value[i] < ring->value[ring->darkest])
            ring->darkest = i;
    }
    return 1;
}

/* The angle from one sensor to another, in (-PI, PI]. */
static double between_rad(int from, int to)
{
    double angle_rad = vs_robot_sensor_angle_rad[to] - vs_robot_sensor_angle_rad[from];

    if (angle_rad > PI)
        return angle_rad - 2.0 * PI;
    return angle_rad <= -PI ? angle_rad + 2.0 * PI : angle_rad;
}

/* Where the light is: the mean angle of the sensors, weighted by how much brighter than
 * the darkest one each is, and counted from the brightest, so that no angle wraps. */
static double bearing_rad(const struct ring *ring)
{
    double sum = 0.0;
    double weights = 0.0;
    int i;

    for (i = 0; i < SENSORS; i++) {
        double weight = ring->value[i] - ring->value[ring->darkest];

        sum += weight * between_rad(ring->brightest, i);
        weights += weight;
    }
    return vs_robot_sensor_angle_rad[ring->brightest] + sum / weights;
}

static void init(void *state, struct vs_robot *robot)
{
    struct moth *s = state;

    s->light = vs_robot_sensor(robot, "light");
    s->enough = vs_robot_param_in(robot, "enough", 8.0, 0, INT_MAX);
    s->least = vs_robot_param_in(robot, "least", 0.02, 0, INT_MAX);
    vs_walk_init(&s->walk, robot);
}

/* A stale value is no news: whoever rests goes on, nobody steers by it. */
static void step(void *state, struct vs_robot *robot)
{
    struct moth *s = state;
    struct ring ring;
    int known = look(s, robot, &ring);
    int stale = vs_robot_read(robot, s->light).stale;
    double brightest = known ? ring.value[ring.brightest] : 0.0;

    if (!known || !stale)
        s->resting = brightest >= s->enough;
    vs_robot_set_leds(robot, s->resting ? VS_ROBOT_LED_RING : 0);
    if (s->resting)
        vs_walk_rest(&s->walk, robot);
    else if (known && !stale && brightest - ring.value[ring.darkest] >= s->least)
        vs_walk_towards(&s->walk, robot, bearing_rad(&ring));
    else
        vs_walk_wander(&s->walk, robot);
}

const struct vs_controller vs_controller = {"phototaxis", sizeof(struct moth), init, step, NULL};
