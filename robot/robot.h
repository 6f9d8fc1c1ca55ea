/* SPDX-License-Identifier: MIT */
/*
 * robot.h - what stands behind controller.h's struct vs_robot: the session's
 * newest state, the base's newest reading, and what the controller set. Pure.
 */
#ifndef VS_ROBOT_H
#define VS_ROBOT_H

#include "base_sensors.h"
#include "controller.h"
#include "log.h"
#include "../c_src/vs_session.h"

#define VS_STALE_TENTHS 25 /* [timestep/10] a reading older than this is stale */

#define VS_OWN 1000 /* first handle of the robot's own devices, alone or fused with virtual ones */
#define VS_FAILURE_BYTES 800 /* all of it fits the lines of a log that wait */

struct vs_robot {
    const struct vs_session *session;
    uint64_t session_ns;    /* session's clock at this control step */
    uint64_t now_ns;        /* base's clock at this control step */
    struct vs_base_reading base;
    uint64_t base_ns;       /* base's clock: when that came, 0 = never */
    struct vs_base_command command;
    uint8_t actuators[VS_ACTUATOR_BYTES]; /* what goes up, as TELEMETRY carries it, but for ages */
    uint64_t said_ns[VS_TABLE_MAX]; /* session's clock: entry n's reading was set, 0 = never */
    uint8_t raw;                 /* 1: the robot's own readings are left as they are measured */
    uint8_t show_failed;         /* which was complained of */
    uint8_t shown_len;
    uint8_t shown[VS_SHOWN_MAX]; /* vs_shown.h */
    struct vs_log log;           /* outlives runs and sessions */
    char failure[VS_FAILURE_BYTES]; /* why the controller cannot go on, "" while it can */
    uint64_t random;
    uint32_t heard_from;    /* messages of the board before this one are old */
    uint32_t heard_until;   /* those that this control step sees */
    uint32_t bound;         /* bit n: entry n of the table is bound */
    uint8_t asked[VS_PARAMS_ROOM / 8]; /* bit n: the parameter at params[n] was asked for */
    /* called, unless NULL, by vs_robot_complain */
    void (*complain)(void *context, const char *what, const char *name);
    void *context;
};

/* Makes the robot ready for a controller's init: nothing bound, nothing set, the
 * random generator seeded. */
void vs_robot_begin(struct vs_robot *robot, const struct vs_session *session);

/* Virtual actuators and shown values are nothing again, as before a run's begin. */
void vs_robot_forget(struct vs_robot *robot);

/* A control step begins: what the base's boards heard since the one before is new. */
void vs_robot_begin_step(struct vs_robot *robot);

/* Outside a run: LEDs off, nothing to say. */
void vs_robot_rest(struct vs_robot *robot);

/* Reports what a controller asked for in vain: what, and its name. */
void vs_robot_complain(struct vs_robot *robot, const char *what, const char *name);

/* The first parameter "name=value" behind after (NULL: of all) that no controller asked
 * for, NULL if there is none. */
const char *vs_robot_unasked_param(const struct vs_robot *robot, const char *after);

/* 1 if something measured age_ns ago is stale. */
int vs_robot_is_stale(const struct vs_session *session, uint64_t age_ns);

#endif
