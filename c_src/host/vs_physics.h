/* SPDX-License-Identifier: MIT */
/*
 * vs_physics.h - the floor of lab and simulation: robots that drive by stepper motors,
 * bodies and boxes that stand, and nobody inside anybody. Time is an argument: the same
 * calls give the same bits.
 */
#ifndef VS_PHYSICS_H
#define VS_PHYSICS_H

#include <stdint.h>

#define VS_BOX_NUMBERS 6    /* of a box: x_m, y_m, cosine, sine of its yaw, half its sizes */
#define VS_TICK_NS 10000000 /* [ns] contacts are looked at this often */

/* How a robot drives. */
struct vs_drive {
    double step_m;       /* way of a wheel per motor step */
    double half_turn;    /* 0.5 / axle [1/m], the axle between the wheels' contact points */
    double most_m_s2;    /* how fast a wheel's speed changes, 0: at once */
    double mobility;     /* how readily it gives way while its wheels turn, 1 for the lightest */
    int32_t timer_hz;    /* a motor makes a step every whole number of such ticks; 0: as told */
    int32_t max_steps_s; /* faster commands count as that */
};

/* A robot, and what is near it: a body (other < bodies) or box other - bodies. */
struct vs_pair {
    uint32_t robot;
    uint32_t other;
};

/*
 * Who stands near whom: the pairs that can touch or be felt. They are searched for again
 * only when somebody has moved far enough to matter, so most ticks pay nothing for them.
 * All arrays are the caller's. Bodies are discs, the first ones robots.
 */
struct vs_near {
    uint32_t robots;        /* bodies that feel and give way */
    uint32_t bodies;
    uint32_t boxes;
    double reach_m;         /* farthest thing that any robot can touch or feel from its centre */
    const double *radii_m;  /* [bodies] */
    const double *box_rows; /* [boxes * VS_BOX_NUMBERS] */
    double *searched_m;     /* [bodies * 2] where everybody was at the last search */
    struct vs_pair *pairs;  /* [robots * (bodies + boxes)]: by robot, then by other */
    uint32_t *next;         /* [bodies] scratch */
    uint32_t *heads;        /* [2 * bodies] scratch */
    uint32_t count;         /* pairs in use */
    uint32_t searches;      /* done so far; set it to 0 to have the pairs searched anew */
};

/* A robot that touches a body or a box, or nearly. */
struct vs_contact {
    struct vs_pair pair;
    double gap_m;     /* before any push, negative where they overlap */
    double normal[2]; /* unit vector towards the robot */
    double push_m;    /* found: how much this contact pushes, >= 0 */
    double ahead_m;   /* scratch: the guess that goes on from there */
    double change_m;  /* scratch: of push_m in the newest iteration */
    uint32_t next[2]; /* scratch: the next contact of the robot, and of the other */
};

/* All arrays are the caller's; each of contacts and before has as much room as near's pairs. */
struct vs_contacts {
    struct vs_near *near;
    const double *mobility;    /* [bodies] how readily each gives way, 0: not at all */
    struct vs_contact *now;    /* [count] */
    struct vs_contact *before; /* [kept] of the call before; the two change places */
    double *moved_m;           /* [bodies * 2] scratch */
    uint32_t *newest;          /* [bodies] scratch */
    uint32_t count;
    uint32_t kept;
};

/* All arrays are the caller's. */
struct vs_physics {
    struct vs_contacts *contacts; /* and with it who is near whom */
    double *poses;       /* [bodies * 3] x_m, y_m, yaw_rad; robots first */
    double *mobility;    /* [bodies] that of contacts: set for robots, 0 for what stands */
    double *wheels_m_s;  /* [robots * 2] what the wheels do, left and right */
    int16_t *commands;   /* [robots * 2] newest commands [step/s] */
    int64_t *rolled_ns;  /* [robots] their poses hold for this time but for contacts */
    double *arcs;        /* [robots * 2] of the newest roll: half the turn, and chord over way */
    const struct vs_drive *drives; /* [robots] */
    const double *built; /* [robots * 3] ways of left and right wheel over nominal, and axle [m];
                          * NULL: all are as drives says */
    int64_t tick_ns;     /* time of the newest tick */
};

/* A scene at rest at time_ns; all but commands, wheels_m_s, rolled_ns and the robots'
 * mobility is set. */
void vs_physics_init(struct vs_physics *physics, int64_t time_ns);

/* Lets a robot's wheels turn at new speeds from time_ns on; a time before the newest tick
 * counts as the time of that tick: the past stays as it is. */
void vs_physics_drive(struct vs_physics *physics, uint32_t robot, int left_steps_s,
                      int right_steps_s, int64_t time_ns);

/* vs_physics_drive for all robots; commands [robots * 2], left and right. */
void vs_physics_drive_all(struct vs_physics *physics, const int16_t *commands,
                          int64_t time_ns);

/* Moves everything on to time_ns, later than all calls before. */
void vs_physics_tick(struct vs_physics *physics, int64_t time_ns);

/* Ticks every VS_TICK_NS up to time_ns, the last one there; none if it is not later. */
void vs_physics_advance(struct vs_physics *physics, int64_t time_ns);

#endif
