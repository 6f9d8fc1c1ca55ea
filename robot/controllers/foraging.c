/* SPDX-License-Identifier: MIT */
/*
 * foraging.c - ants: look for food, carry it home, and leave a trail of pheromone on
 * the way; who comes upon a trail follows it away from the nest.
 *
 * Food and nest are told by the floor's colour, the way home by the sensor
 * "destination". A trail has no direction of its own, but it leads home at one end.
 *
 * Parameters: release of pheromone per second on the way home (1), trail, least
 * concentration that is followed (3), pull towards its middle (0.05), and those of walk.h.
 * It shows what it does and how often it brought food home, and logs each time.
 */
#include "controller.h"

#define PI 3.14159265358979
#define PULL_MAX_RAD 1.0 /* how far a trail's middle turns an ant off its way */

enum place { NOWHERE, NEST, FOOD };

struct ant {
    int floor;
    int home;
    int pheromone;
    int gland;
    double release;
    double trail;
    double pull;
    int carrying;
    int delivered;
    struct vs_walk walk;
};

static void init(void *state, struct vs_robot *robot)
{
    struct ant *s = state;

    s->floor = vs_robot_sensor(robot, "rgb_ground");
    s->home = vs_robot_sensor(robot, "destination");
    s->pheromone = vs_robot_sensor(robot, "pheromone");
    s->gland = vs_robot_actuator(robot, "pheromone_release");
    s->release = vs_robot_param_in(robot, "release", 1.0, 0, INT_MAX);
    s->trail = vs_robot_param_in(robot, "trail", 3.0, 0, INT_MAX);
    s->pull = vs_robot_param_in(robot, "pull", 0.05, 0, INT_MAX);
    vs_walk_init(&s->walk, robot);
    vs_robot_show(robot, "delivered", 0.0);
}

/* The nest is blue, food is green, all else is neither. */
static enum place standing_on(const struct ant *s, const struct vs_robot *robot)
{
    double color[4]; /* red, green, blue, alpha */

    if (vs_robot_values(robot, s->floor, color, 4) != 4 || color[0] > 100.0)
        return NOWHERE;
    if (color[1] > 200.0 && color[2] < 100.0)
        return FOOD;
    return color[2] > 200.0 && color[1] < 100.0 ? NEST : NOWHERE;
}

/* Where the nest is, counter-clockwise from straight ahead; 0 if that is not known. */
static int nest_bearing(const struct ant *s, const struct vs_robot *robot, double *bearing_rad)
{
    double home[5]; /* x, y, heading, distance [m], bearing [rad] */

    if (vs_robot_values(robot, s->home, home, 5) != 5 || vs_robot_read(robot, s->home).stale)
        return 0;
    *bearing_rad = home[4];
    return 1;
}

/* By how much to turn to the side with more pheromone; 0 where there is no trail. */
static int on_trail(const struct ant *s, const struct vs_robot *robot, double *turn_rad)
{
    double smell[3]; /* concentration, gradient ahead and left */

    if (vs_robot_values(robot, s->pheromone, smell, 3) != 3 || smell[0] < s->trail)
        return 0;
    *turn_rad = s->pull * smell[2] / smell[0];
    if (*turn_rad > PULL_MAX_RAD)
        *turn_rad = PULL_MAX_RAD;
    if (*turn_rad < -PULL_MAX_RAD)
        *turn_rad = -PULL_MAX_RAD;
    return 1;
}

static void deliver(struct ant *s, struct vs_robot *robot)
{
    vs_robot_show(robot, "delivered", ++s->delivered);
    vs_robot_log(robot, "brought food home");
}

static void step(void *state, struct vs_robot *robot)
{
    struct ant *s = state;
    enum place place = standing_on(s, robot);
    double nest_rad = 0.0;
    double turn_rad = 0.0;
    const char *does = "carries home";
    int oriented = nest_bearing(s, robot, &nest_rad);

    if (s->carrying && place == NEST)
        deliver(s, robot);
    s->carrying = place == FOOD || (s->carrying && place != NEST);
    vs_robot_set_leds(robot, s->carrying ? VS_ROBOT_LED_RING : 0);
    vs_robot_actuate(robot, s->gland, 0, s->carrying ? s->release : 0.0);
    if (oriented && s->carrying) {
        vs_walk_towards(&s->walk, robot, nest_rad);
    } else if (oriented && on_trail(s, robot, &turn_rad)) {
        vs_walk_towards(&s->walk, robot, nest_rad + PI + turn_rad);
        does = "follows a trail";
    } else {
        vs_walk_wander(&s->walk, robot);
        does = "searches";
    }
    vs_robot_show_text(robot, "does", does);
}

const struct vs_controller vs_controller = {"foraging", sizeof(struct ant), init, step, NULL};
