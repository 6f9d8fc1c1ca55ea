/* SPDX-License-Identifier: MIT */
/*
 * pollutant.c - the robots of the thesis's chapter 5: wander through the arena;
 * where the pollutant is sensed, stop with a probability at every timestep and
 * light the red LEDs, as if cleaning; go on when it has gone.
 *
 * Parameters: stop_probability per timestep (0.3), speed_cm_s (10), walk_s mean
 * duration of a straight run (4), near_raw proximity that counts as an obstacle (150,
 * about 4 cm).
 */
#include "controller.h"

#define PI 3.14159265358979
#define AHEAD_RAD 1.5 /* sensors beyond it do not look where we go */
#define AXLE_CM 5.3
#define TURN_SHARE 0.6 /* of the speed, for turning on the spot */

enum activity { WALK, TURN, AVOID, CLEAN };

struct cleaner {
    int pollutant;
    int proximity;
    double stop_probability;
    double speed_steps_s;
    double walk_s;
    double near_raw;
    enum activity activity;
    double left_s;    /* [s] of the present walk or turn */
    double direction; /* of the present turn: 1 left, -1 right */
};

/* A stale value is no news: whoever cleans goes on until told that the pollutant has
 * gone, and nobody else begins. A bad moment of the network must not scatter a swarm. */
static int senses_pollutant(const struct cleaner *s, const struct vs_robot *robot)
{
    struct vs_reading reading = vs_robot_read(robot, s->pollutant);

    if (reading.known && reading.stale)
        return s->activity == CLEAN;
    return reading.known && reading.value >= 0.5;
}

/* How much stands ahead: > 0 if anything does; *side is 1 if it is rather on the
 * left, -1 on the right. */
static double obstacle(const struct cleaner *s, const struct vs_robot *robot, double *side)
{
    double prox[8];
    double ahead = 0.0;
    double left = 0.0;
    int i;

    if (vs_robot_values(robot, s->proximity, prox, 8) != 8)
        return 0.0;
    for (i = 0; i < 8; i++) {
        double angle_rad = vs_robot_sensor_angle_rad[i];

        if (prox[i] < s->near_raw || angle_rad > AHEAD_RAD || angle_rad < -AHEAD_RAD)
            continue;
        ahead += prox[i];
        left += prox[i] * (angle_rad > 0.0 ? 1.0 : -1.0);
    }
    *side = left >= 0.0 ? 1.0 : -1.0;
    return ahead;
}

/* Time that turning by angle_rad on the spot takes. */
static double turn_time_s(const struct cleaner *s, double angle_rad)
{
    double rim_cm_s = TURN_SHARE * s->speed_steps_s / VS_ROBOT_STEPS_PER_CM;

    return angle_rad * AXLE_CM / 2.0 / (rim_cm_s > 0.1 ? rim_cm_s : 0.1);
}

static void begin_walk(struct cleaner *s, struct vs_robot *robot)
{
    s->activity = WALK;
    s->left_s = 2.0 * s->walk_s * vs_robot_random(robot);
}

static void begin_turn(struct cleaner *s, struct vs_robot *robot)
{
    s->activity = TURN;
    s->direction = vs_robot_random(robot) < 0.5 ? 1.0 : -1.0;
    s->left_s = turn_time_s(s, PI * vs_robot_random(robot));
}

/* One direction until the way is free, and up to 90 degrees more: a robot that
 * changed its mind in a corner would stay there. */
static void avoid(struct cleaner *s, struct vs_robot *robot)
{
    double side = 1.0;
    double ahead = obstacle(s, robot, &side);

    if (ahead > 0.0 && s->activity != AVOID) {
        s->activity = AVOID;
        s->direction = -side;
    } else if (ahead <= 0.0 && s->activity == AVOID) {
        s->activity = TURN;
        s->left_s = turn_time_s(s, PI / 2.0 * vs_robot_random(robot));
    }
}

static void wander(struct cleaner *s, struct vs_robot *robot)
{
    double spin = TURN_SHARE * s->speed_steps_s;

    s->left_s -= vs_robot_timestep_s(robot);
    if (s->activity == CLEAN || (s->activity == TURN && s->left_s <= 0.0))
        begin_walk(s, robot);
    else if (s->activity == WALK && s->left_s <= 0.0)
        begin_turn(s, robot);
    avoid(s, robot);
    if (s->activity == WALK)
        vs_robot_set_wheels(robot, (int)s->speed_steps_s, (int)s->speed_steps_s);
    else
        vs_robot_set_wheels(robot, (int)(-s->direction * spin), (int)(s->direction * spin));
}

/* A parameter that is a speed: forwards, and no faster than the motors can. */
static double speed_param_steps_s(struct vs_robot *robot)
{
    double speed_steps_s = vs_robot_param(robot, "speed_cm_s", 10.0) * VS_ROBOT_STEPS_PER_CM;

    if (speed_steps_s > VS_ROBOT_MAX_STEPS_S)
        return VS_ROBOT_MAX_STEPS_S;
    return speed_steps_s > 0.0 ? speed_steps_s : 0.0;
}

static void init(void *state, struct vs_robot *robot)
{
    struct cleaner *s = state;

    s->pollutant = vs_robot_sensor(robot, "pollutant");
    s->proximity = vs_robot_sensor(robot, "proximity");
    s->stop_probability = vs_robot_param(robot, "stop_probability", 0.3);
    s->speed_steps_s = speed_param_steps_s(robot);
    s->walk_s = vs_robot_param(robot, "walk_s", 4.0);
    s->near_raw = vs_robot_param(robot, "near_raw", 150.0);
    begin_walk(s, robot);
}

static void step(void *state, struct vs_robot *robot)
{
    struct cleaner *s = state;
    int sensed = senses_pollutant(s, robot);

    if (sensed && s->activity != CLEAN && vs_robot_random(robot) < s->stop_probability)
        s->activity = CLEAN;
    if (sensed && s->activity == CLEAN) {
        vs_robot_set_wheels(robot, 0, 0);
        vs_robot_set_leds(robot, VS_ROBOT_LED_RING);
        return;
    }
    vs_robot_set_leds(robot, 0);
    wander(s, robot);
}

const struct vs_controller vs_controller = {"pollutant", sizeof(struct cleaner), init, step};
