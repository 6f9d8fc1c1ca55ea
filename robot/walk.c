/* SPDX-License-Identifier: MIT */
#include "controller.h"

#define PI 3.14159265358979
#define AXLE_CM 5.3
#define TURN_SHARE 0.6 /* of the speed, for turning on the spot */
#define PASS_S 1.0     /* [s] longest way past an obstacle before the goal counts again */

/* The sensors that look where we go, less than a right angle off; on which side they are. */
static const struct {
    int sensor;
    double side;
} ahead_of[4] = {{0, -1.0}, {1, -1.0}, {6, 1.0}, {7, 1.0}};

double vs_walk_obstacle(const struct vs_walk *walk, const struct vs_robot *robot, double *side)
{
    double prox[8];
    double ahead = 0.0;
    double left = 0.0;
    int i;

    *side = 1.0;
    if (vs_robot_values(robot, walk->proximity, prox, 8) != 8)
        return 0.0;
    for (i = 0; i < 4; i++) {
        double here = prox[ahead_of[i].sensor];

        if (here < walk->near_raw)
            continue;
        ahead += here;
        left += here * ahead_of[i].side;
    }
    *side = left >= 0.0 ? 1.0 : -1.0;
    return ahead;
}

/* Time that turning by angle_rad on the spot takes. */
static double turn_time_s(const struct vs_walk *walk, double angle_rad)
{
    double rim_cm_s = TURN_SHARE * walk->speed_steps_s / VS_ROBOT_STEPS_PER_CM;

    return angle_rad * AXLE_CM / 2.0 / (rim_cm_s > 0.1 ? rim_cm_s : 0.1);
}

static void begin_straight(struct vs_walk *walk, struct vs_robot *robot)
{
    walk->activity = VS_WALK_STRAIGHT;
    walk->left_s = 2.0 * walk->walk_s * vs_robot_random(robot);
}

static void begin_turn(struct vs_walk *walk, struct vs_robot *robot)
{
    walk->activity = VS_WALK_TURN;
    walk->direction = vs_robot_random(robot) < 0.5 ? 1.0 : -1.0;
    walk->left_s = turn_time_s(walk, PI * vs_robot_random(robot));
}

/* One direction until the way is free, and up to 90 degrees more: a robot that
 * changed its mind in a corner would stay there. */
static void avoid(struct vs_walk *walk, struct vs_robot *robot)
{
    double side;
    double ahead = vs_walk_obstacle(walk, robot, &side);

    if (ahead > 0.0 && walk->activity != VS_WALK_AVOID) {
        walk->activity = VS_WALK_AVOID;
        walk->direction = -side;
    } else if (ahead <= 0.0 && walk->activity == VS_WALK_AVOID) {
        walk->activity = VS_WALK_EVADE;
        walk->left_s = turn_time_s(walk, PI / 2.0 * vs_robot_random(robot));
    }
}

/* Straight on, or a turn on the spot, as the activity says. */
static void drive(const struct vs_walk *walk, struct vs_robot *robot)
{
    double spin = TURN_SHARE * walk->speed_steps_s;

    if (walk->activity == VS_WALK_STRAIGHT || walk->activity == VS_WALK_PASS)
        vs_robot_set_wheels(robot, (int)walk->speed_steps_s, (int)walk->speed_steps_s);
    else
        vs_robot_set_wheels(robot, (int)(-walk->direction * spin), (int)(walk->direction * spin));
}

static int is_turning(const struct vs_walk *walk)
{
    return walk->activity == VS_WALK_TURN || walk->activity == VS_WALK_EVADE;
}

void vs_walk_wander(struct vs_walk *walk, struct vs_robot *robot)
{
    int goal = walk->activity == VS_WALK_STEER || walk->activity == VS_WALK_PASS;

    walk->left_s -= vs_robot_timestep_s(robot);
    if (walk->activity == VS_WALK_REST || goal || (is_turning(walk) && walk->left_s <= 0.0))
        begin_straight(walk, robot);
    else if (walk->activity == VS_WALK_STRAIGHT && walk->left_s <= 0.0)
        begin_turn(walk, robot);
    avoid(walk, robot);
    drive(walk, robot);
}

/* The angle in (-PI, PI]; 0 for what is no angle. */
static double wrap(double angle_rad)
{
    double turns = angle_rad / (2.0 * PI);

    if (!(turns > -1e9 && turns < 1e9))
        return 0.0;
    turns -= (double)(int)turns;
    if (turns > 0.5)
        turns -= 1.0;
    return (turns <= -0.5 ? turns + 1.0 : turns) * 2.0 * PI;
}

/* Less forwards and more of a turn the farther the goal lies beside; from 90 degrees on
 * the spot. Linear in the angle: the robot has no mathematics library. */
static void steer(const struct vs_walk *walk, struct vs_robot *robot, double bearing_rad)
{
    double share = wrap(bearing_rad) / (PI / 2.0);
    double size = share < 0.0 ? -share : share;
    double ahead = size < 1.0 ? (1.0 - size) * walk->speed_steps_s : 0.0;
    double turn = TURN_SHARE * walk->speed_steps_s * (size < 1.0 ? share : share / size);

    vs_robot_set_wheels(robot, (int)(ahead - turn), (int)(ahead + turn));
}

void vs_walk_towards(struct vs_walk *walk, struct vs_robot *robot, double bearing_rad)
{
    walk->left_s -= vs_robot_timestep_s(robot);
    if (walk->activity == VS_WALK_EVADE && walk->left_s <= 0.0) {
        walk->activity = VS_WALK_PASS;
        walk->left_s = PASS_S * vs_robot_random(robot);
    } else if (walk->activity != VS_WALK_AVOID && walk->activity != VS_WALK_EVADE &&
               (walk->activity != VS_WALK_PASS || walk->left_s <= 0.0)) {
        walk->activity = VS_WALK_STEER;
    }
    avoid(walk, robot);
    if (walk->activity == VS_WALK_STEER)
        steer(walk, robot, bearing_rad);
    else
        drive(walk, robot);
}

void vs_walk_rest(struct vs_walk *walk, struct vs_robot *robot)
{
    walk->activity = VS_WALK_REST;
    vs_robot_set_wheels(robot, 0, 0);
}

/* A parameter that is a speed: forwards, and no faster than the motors can. */
static double speed_param_steps_s(struct vs_robot *robot)
{
    double speed_steps_s =
        vs_robot_param_in(robot, "speed_cm_s", 10.0, 0, INT_MAX) * VS_ROBOT_STEPS_PER_CM;

    if (speed_steps_s > VS_ROBOT_MAX_STEPS_S)
        return VS_ROBOT_MAX_STEPS_S;
    return speed_steps_s > 0.0 ? speed_steps_s : 0.0;
}

void vs_walk_init(struct vs_walk *walk, struct vs_robot *robot)
{
    walk->proximity = vs_robot_sensor(robot, "proximity");
    walk->speed_steps_s = speed_param_steps_s(robot);
    walk->walk_s = vs_robot_param_in(robot, "walk_s", 4.0, 0, INT_MAX);
    walk->near_raw = vs_robot_param_in(robot, "near_raw", 150.0, 0, INT_MAX);
    walk->direction = 1.0;
    begin_straight(walk, robot);
}
