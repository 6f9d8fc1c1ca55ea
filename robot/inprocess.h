/* SPDX-License-Identifier: MIT */
/*
 * inprocess.h - all robots of a simulation in one process, on virtual time. Each has the
 * daemon's own mind (session, loop, safety, robot) and one copy of the controller's state;
 * host, network, guard and base are as they should be and take no time. Pure, and no memory
 * but what the caller gives: one shared object with one controller linked in.
 */
#ifndef VS_INPROCESS_H
#define VS_INPROCESS_H

#include <stddef.h>
#include <stdint.h>

#ifdef __GNUC__
#pragma GCC visibility push(default)
#endif

struct vs_inprocess;

/* What is going on, for whoever watches from outside; one writer. */
struct vs_inprocess_progress {
    uint32_t timestep; /* of the newest vs_inprocess_step */
    uint32_t robot;    /* 1 + the robot that is in its control step, 0: none is */
};

/* One timestep of all robots; the arrays are the caller's, row by row in the order of the
 * robots. */
struct vs_inprocess_timestep {
    uint8_t wanted;              /* enum vs_run_state */
    uint32_t from_timestep;      /* with VS_RUN: the first timestep of the run */
    uint32_t timestep;
    uint64_t capture_ns;         /* when the arena was seen */
    uint64_t now_ns;             /* when the controllers act on that */
    const uint8_t *values;       /* [robots * table's sensor_bytes] the sensors' blocks */
    const int64_t *captures_ns;  /* [robots * table's sensors] of each value, -1: never */
    const int16_t *prox;         /* [robots * 8] raw, ps0..ps7, higher is nearer */
    const int16_t *light;        /* [robots * 8] raw, ps0..ps7, higher is brighter */
    const int16_t *goals;        /* with VS_HOME: [robots * 3] goal ahead and to the left [mm],
                                  * goal_heading [1e-4 rad], as STATE has them; else NULL */
    /* what comes of it */
    int16_t *wheels_steps_s;     /* [robots * 2] left and right, after safety */
    uint16_t *leds;              /* [robots] bits 0-7 ring, 8 body, 9 front */
    uint8_t *reports;            /* [robots * table's actuator_bytes] the actuators' blocks */
    uint8_t *shown;              /* [robots * 256] bytes in use, and the values of vs_shown.h */
    uint32_t logged;             /* lines that wait for vs_inprocess_log */
    uint32_t failed;             /* robots whose controllers cannot go on */
};

/* Name of the controller that is linked in. */
const char *vs_inprocess_controller(void);

/* Bytes of memory, aligned for any type, that so many robots need. */
size_t vs_inprocess_size(uint32_t robots);

/* Robots that nobody has greeted yet. progress stays the caller's. Errors: VS_ERR_TEXT, the
 * controller's name is no text of at most 31 bytes; VS_ERR_SPACE, its state is too large. */
int vs_inprocess_init(struct vs_inprocess *all, uint32_t robots,
                      volatile struct vs_inprocess_progress *progress);

/* All robots are of another model than an e-puck: their motors' limit [step/s], the way of a wheel
 * per step, and the distance of the wheels. */
void vs_inprocess_embody(struct vs_inprocess *all, int16_t max_steps_s, uint32_t step_nm,
                         uint32_t axle_um);

/* A robot gets the host's WELCOME. Errors: those of vs_packet_open, vs_decode_welcome
 * and vs_session_offer, VS_ERR_TYPE. */
int vs_inprocess_welcome(struct vs_inprocess *all, uint32_t robot, uint16_t tag,
                         const uint8_t *packet, size_t len);

/* Every controller begins its run now, and not with its first control step. */
void vs_inprocess_begin(struct vs_inprocess *all);

/* One timestep, later than the one before, of robots that all got the same table. Errors:
 * VS_ERR_STATE after vs_inprocess_end: nothing happens. */
int vs_inprocess_step(struct vs_inprocess *all, struct vs_inprocess_timestep *now);

/* The next line that a controller has logged: 1 and the robot, the line's number (1.. for
 * each robot; a gap: lines were lost) and its text, or 0 if none waits. */
int vs_inprocess_log(struct vs_inprocess *all, uint32_t *robot, uint32_t *number,
                     const char **line);

/* Why a controller cannot go on, and which robot's; NULL if all can. */
const char *vs_inprocess_failure(const struct vs_inprocess *all, uint32_t *robot);

/* The run is over: every controller ends. */
void vs_inprocess_end(struct vs_inprocess *all);

/* What the controllers asked for in vain or do not know: one line each, every line once,
 * all in the daemon's words. Ends with a zero. */
const char *vs_inprocess_complaints(const struct vs_inprocess *all);

#ifdef __GNUC__
#pragma GCC visibility pop
#endif

#endif
