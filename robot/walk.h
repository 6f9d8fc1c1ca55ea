/* SPDX-License-Identifier: MIT */
/*
 * walk.h - how a robot gets about, for controllers; controller.h includes it. Every
 * control step ask for one of: wander, go towards, rest.
 *
 *     struct cleaner { int pollutant; struct vs_walk walk; };
 *     in init:  vs_walk_init(&c->walk, robot);
 *     in step:  dirty ? vs_walk_rest(&c->walk, robot) : vs_walk_wander(&c->walk, robot);
 *
 * Obstacles are what the sensor "proximity" sees ahead, real ones and, where the
 * host offers them, virtual ones.
 */
#ifndef VS_WALK_H
#define VS_WALK_H

#ifdef __cplusplus
extern "C" {
#endif

struct vs_robot;

enum vs_walk_activity {
    VS_WALK_STRAIGHT, /* a straight run of a random walk */
    VS_WALK_TURN,     /* its turn on the spot */
    VS_WALK_AVOID,    /* turns away from what stands ahead */
    VS_WALK_EVADE,    /* turns on, where the way is free again */
    VS_WALK_PASS,     /* passes by, before it heads for its goal again */
    VS_WALK_STEER,    /* heads for its goal */
    VS_WALK_REST
};

/* Belongs into the controller's state; vs_walk_init fills it. */
struct vs_walk {
    int proximity;        /* handle of the sensor */
    double speed_steps_s; /* [step/s] straight on, 0..VS_ROBOT_MAX_STEPS_S */
    double walk_s;        /* [s] mean duration of a straight run */
    double near_raw;      /* proximity that counts as an obstacle */
    enum vs_walk_activity activity;
    double left_s;        /* [s] of the present run or turn */
    double direction;     /* of the present turn: 1 left, -1 right */
};

/* Binds "proximity" and reads the experiment's parameters speed_cm_s (10), walk_s
 * (4) and near_raw (150, about 4 cm); for init. Draws one random number. */
void vs_walk_init(struct vs_walk *walk, struct vs_robot *robot);

/* One control step of a random walk: straight runs of 0..2 walk_s, turns on the spot
 * by 0..180 degrees either way; turns away from obstacles. Sets the wheels. */
void vs_walk_wander(struct vs_walk *walk, struct vs_robot *robot);

/* One control step towards bearing_rad, counter-clockwise from straight ahead (any
 * finite angle; NaN: straight on): turns on the spot where it lies beside or behind,
 * else drives a curve; obstacles are passed by first. Sets the wheels. */
void vs_walk_towards(struct vs_walk *walk, struct vs_robot *robot, double bearing_rad);

/* Stands still in this control step; wandering then begins with a new straight run. */
void vs_walk_rest(struct vs_walk *walk, struct vs_robot *robot);

/* How much stands ahead, raw proximities added up: 0 if nothing counts as an obstacle.
 * *side becomes 1 if it is rather on the left, -1 on the right. */
double vs_walk_obstacle(const struct vs_walk *walk, const struct vs_robot *robot, double *side);

#ifdef __cplusplus
}
#endif

#endif
