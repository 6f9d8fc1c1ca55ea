/* SPDX-License-Identifier: MIT */
/*
 * prey.c - wanders, leaves a scent, and flees from the nearest predator that it sees; who
 * is caught stands still in the dark for a while, and then lives on. A predator is
 * whoever shines red; itself shines green, which predators see. Its twin is predator.c.
 *
 * Shining are the virtual LEDs; the real ring is lit while it is caught.
 *
 * Parameters: caught_cm, a predator this near has caught it (12), rest_s, how long it then
 * rests (10), release of scent per second (1), and those of walk.h. It shows how often it
 * was caught, and logs each time.
 */
#include "controller.h"

#define PI 3.14159265358979
#define PLACES 6 /* robots that the sensor "leds" tells of, at most */
#define SHINE 255.0
#define BRIGHT 128.0

struct prey {
    int lights;
    int lamp;
    int gland;
    double caught_cm;
    double rest_s;
    double release;
    double left_s; /* [s] of its rest */
    int caught;    /* so often */
    struct vs_walk walk;
};

static void init(void *state, struct vs_robot *robot)
{
    struct prey *s = state;

    s->lights = vs_robot_sensor(robot, "leds");
    s->lamp = vs_robot_actuator(robot, "led_color");
    s->gland = vs_robot_actuator(robot, "scent_release");
    s->caught_cm = vs_robot_param_in(robot, "caught_cm", 12.0, 0, INT_MAX);
    s->rest_s = vs_robot_param_in(robot, "rest_s", 10.0, 0, INT_MAX);
    s->release = vs_robot_param_in(robot, "release", 1.0, 0, INT_MAX);
    vs_walk_init(&s->walk, robot);
    vs_robot_show(robot, "caught", 0.0);
}

/* How far the nearest predator is [cm], and its bearing, counter-clockwise from straight
 * ahead; 0 if none is seen. */
static int see_predator(const struct prey *s, const struct vs_robot *robot, double *far_cm,
                        double *bearing_rad)
{
    double seen[1 + 5 * PLACES]; /* how many; distance, bearing, red, green, blue of each */
    int size = vs_robot_values(robot, s->lights, seen, 1 + 5 * PLACES);
    int count = size > 0 ? (int)seen[0] : 0;
    int i;

    if (size < 1 + 5 * count || vs_robot_read(robot, s->lights).stale)
        return 0;
    for (i = 0; i < count; i++) {
        const double *light = seen + 1 + 5 * i;

        if (light[2] > BRIGHT && light[3] < BRIGHT) {
            *far_cm = light[0];
            *bearing_rad = light[1];
            return 1;
        }
    }
    return 0;
}

static void be_caught(struct prey *s, struct vs_robot *robot)
{
    s->left_s = s->rest_s;
    vs_robot_show(robot, "caught", ++s->caught);
    vs_robot_log(robot, "was caught");
}

static void step(void *state, struct vs_robot *robot)
{
    struct prey *s = state;
    double far_cm = 0.0;
    double bearing_rad = 0.0;
    int sees = see_predator(s, robot, &far_cm, &bearing_rad);
    int rests;

    s->left_s -= vs_robot_timestep_s(robot);
    if (s->left_s <= 0.0 && sees && far_cm < s->caught_cm)
        be_caught(s, robot);
    rests = s->left_s > 0.0;
    vs_robot_set_leds(robot, rests ? VS_ROBOT_LED_RING : 0);
    vs_robot_actuate(robot, s->lamp, 1, rests ? 0.0 : SHINE);
    vs_robot_actuate(robot, s->gland, 0, rests ? 0.0 : s->release);
    if (rests)
        vs_walk_rest(&s->walk, robot);
    else if (sees)
        vs_walk_towards(&s->walk, robot, bearing_rad + PI);
    else
        vs_walk_wander(&s->walk, robot);
}

const struct vs_controller vs_controller = {"prey", sizeof(struct prey), init, step, NULL};
