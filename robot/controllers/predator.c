/* SPDX-License-Identifier: MIT */
/*
 * predator.c - hunts: drives after the nearest prey that it sees, follows the scent of
 * those that it does not see, and wanders where it smells none. Prey is whoever shines
 * green; itself shines red, which prey sees. Its twin is prey.c.
 *
 * Shining are the virtual LEDs; the real front LED is lit while prey is in sight.
 *
 * Parameters: scent, least concentration that is followed (0.5), and those of walk.h.
 * It shows what it does.
 */
#include "controller.h"

#define PI 3.14159265358979
#define PLACES 6 /* robots that the sensor "leds" tells of, at most */
#define SHINE 255.0
#define BRIGHT 128.0

struct predator {
    int lights;
    int scent;
    int lamp;
    double least_scent;
    struct vs_walk walk;
};

static void init(void *state, struct vs_robot *robot)
{
    struct predator *s = state;

    s->lights = vs_robot_sensor(robot, "leds");
    s->scent = vs_robot_sensor(robot, "scent");
    s->lamp = vs_robot_actuator(robot, "led_color");
    s->least_scent = vs_robot_param_in(robot, "scent", 0.5, 0, INT_MAX);
    vs_walk_init(&s->walk, robot);
}

/* Where the nearest prey is, counter-clockwise from straight ahead; 0 if none is seen. */
static int see_prey(const struct predator *s, const struct vs_robot *robot, double *bearing_rad)
{
    double seen[1 + 5 * PLACES]; /* how many; distance, bearing, red, green, blue of each */
    int size = vs_robot_values(robot, s->lights, seen, 1 + 5 * PLACES);
    int count = size > 0 ? (int)seen[0] : 0;
    int i;

    if (size < 1 + 5 * count || vs_robot_read(robot, s->lights).stale)
        return 0;
    for (i = 0; i < count; i++) {
        const double *light = seen + 1 + 5 * i;

        if (light[3] > BRIGHT && light[2] < BRIGHT) {
            *bearing_rad = light[1];
            return 1;
        }
    }
    return 0;
}

/* Where the scent grows, as a bearing that is exact ahead, left, right and behind and
 * near enough between; 0 where there is too little. */
static int smell_prey(const struct predator *s, const struct vs_robot *robot, double *bearing_rad)
{
    double smell[3]; /* concentration, gradient ahead and left */
    double ahead;
    double left;

    if (vs_robot_values(robot, s->scent, smell, 3) != 3 || smell[0] < s->least_scent)
        return 0;
    ahead = smell[1] < 0.0 ? -smell[1] : smell[1];
    left = smell[2] < 0.0 ? -smell[2] : smell[2];
    if (ahead + left <= 0.0)
        return 0;
    *bearing_rad = PI / 2.0 * left / (ahead + left);
    if (smell[1] < 0.0)
        *bearing_rad = PI - *bearing_rad;
    if (smell[2] < 0.0)
        *bearing_rad = -*bearing_rad;
    return 1;
}

static void step(void *state, struct vs_robot *robot)
{
    struct predator *s = state;
    double bearing_rad = 0.0;
    int sees = see_prey(s, robot, &bearing_rad);
    const char *does = "hunts";

    vs_robot_actuate(robot, s->lamp, 0, SHINE);
    vs_robot_set_leds(robot, sees ? VS_ROBOT_LED_FRONT : 0);
    if (sees) {
        vs_walk_towards(&s->walk, robot, bearing_rad);
    } else if (smell_prey(s, robot, &bearing_rad)) {
        vs_walk_towards(&s->walk, robot, bearing_rad);
        does = "follows a scent";
    } else {
        vs_walk_wander(&s->walk, robot);
        does = "searches";
    }
    vs_robot_show_text(robot, "does", does);
}

const struct vs_controller vs_controller = {"predator", sizeof(struct predator), init, step, NULL};
