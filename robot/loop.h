/* SPDX-License-Identifier: MIT */
/*
 * loop.h - the worker's mind: when a control step is due, what is asked of the
 * guard, why wheels are held. Pure: the session, replies and times in, requests and
 * telemetry out.
 *
 * One control step: SENSE (the base's readings are one exchange old, so exchange
 * before the controller), the controller, safety, ACT. A step begins with the first
 * datagram of a new timestep, at the latest 1.25 timesteps after the last step, and
 * never less than half a timestep after it. In `home` it is the same step with the walk
 * of homing.h in the controller's place. Outside of both, and without a session, the
 * wheels are 0: at once when that changes, and again with every idle exchange.
 */
#ifndef VS_LOOP_H
#define VS_LOOP_H

#include "calibration.h"
#include "battery.h"
#include "guard.h"
#include "homing.h"
#include "robot.h"
#include "safety.h"

#define VS_LOOP_PING_NS 50000000u      /* [ns] the guard is never left alone longer */
#define VS_LOOP_TELEMETRY_NS 50000000u /* [ns] nor the host, */
#define VS_LOOP_REPORT_NS 75000000u    /* [ns] or this where a control step tells it */
#define VS_LOOP_IDLE_NS 100000000u     /* [ns] idle exchange without a session */

/* A packet may leave twice: one that is lost then costs nothing, and a copy costs no tag. */
enum vs_telling { VS_TELL_NOTHING = 0, VS_TELL_AGAIN = 1, VS_TELL_NEWS = 2 };

/* What the newest TELEMETRY told, of what must not wait for the next one. */
struct vs_told {
    uint32_t run, wanted, cause, log_number;
};

/* Now, on both of the worker's clocks. */
struct vs_instant {
    uint64_t base_ns;    /* the board's clock, vs_posix.h */
    uint64_t session_ns; /* the session's clock */
};

/* Room for what a controller remembers. */
union vs_controller_state {
    uint64_t for_alignment;
    double for_alignment_too;
    unsigned char bytes[VS_CONTROLLER_STATE_MAX];
};

/* What one control step saw and did, for the trace. */
struct vs_step {
    uint32_t number;      /* 1.. */
    uint64_t session_ns;  /* when the controller was called */
    uint64_t age_ns;      /* of the newest capture then, UINT64_MAX = unknown */
    uint8_t stale;
    struct vs_base_command command; /* after safety */
};

struct vs_loop {
    struct vs_session *session;
    const struct vs_controller *controller;
    void *state; /* the controller's, a union vs_controller_state */
    const struct vs_calibration *calibration; /* of this robot, NULL: it is nominal */
    struct vs_robot robot;
    struct vs_safety safety;
    struct vs_homing homing;   /* of this stretch of VS_HOME */
    struct vs_battery battery; /* the owner writes its stop_mv */
    struct vs_base_command applied; /* what the guard said is in force */
    struct vs_base_command command; /* newest asked for */
    struct vs_step step;            /* newest control step */
    uint8_t begun;        /* the controller's init was called */
    uint8_t running;      /* VS_RUN or VS_HOME while the host wants that now, else 0 */
    uint8_t timestep_new; /* a timestep came that no control step has seen */
    uint8_t hold_due;     /* the wheels must be told to stop */
    uint8_t ending;
    uint8_t waiting;      /* a request is with the guard */
    uint8_t asked;        /* enum vs_guard_kind of the newest request */
    uint8_t acting;       /* 1: the controller decided, ACT is due or with the guard */
    uint8_t base_lost;
    uint8_t guard_lost;   /* replaced; until the next ACT */
    uint8_t guard_cause;  /* why the guard holds the wheels */
    uint8_t telemetry_due; /* enum vs_telling */
    uint8_t told_again;   /* the newest TELEMETRY has left twice */
    uint8_t trace_due;    /* step is new */
    uint8_t pacing;       /* a control step of this stretch of running has begun */
    uint8_t talk_due;     /* the controller began with another table or other params */
    uint32_t overruns;    /* control steps that began more than 1.5 timesteps after the last */
    uint32_t completed;   /* control steps whose command reached the base */
    uint32_t run;         /* what init was called for */
    uint32_t offer;       /* session->offer when init was called */
    uint32_t v_max_nm_s;  /* how fast a wheel may be in this session, see safety.h */
    uint32_t seed;
    uint32_t seen_timestep; /* of the newest STATE looked at */
    uint32_t seen_run;
    uint64_t seen_fresh_ns; /* session->fresh_ns then */
    uint64_t begin_ns;    /* base's clock: newest step or idle exchange began */
    uint64_t step_ns;     /* base's clock: newest step began */
    uint64_t sent_ns;     /* base's clock: newest request */
    uint64_t telemetry_ns;/* base's clock: newest telemetry */
    struct vs_told told;
};

/* state: a union vs_controller_state, or smaller if the controller's state is. */
void vs_loop_init(struct vs_loop *loop, struct vs_session *session,
                  const struct vs_controller *controller, void *state);

/* An event of the session. */
void vs_loop_event(struct vs_loop *loop, enum vs_event event, const struct vs_instant *now);

/* 1 and a request for the guard, or 0. Its reply has to come before the next one. */
int vs_loop_request(struct vs_loop *loop, const struct vs_instant *now,
                    struct vs_guard_request *request);

/* The guard's reply. */
void vs_loop_reply(struct vs_loop *loop, const struct vs_guard_reply *reply,
                   const struct vs_instant *now);

/* The guard is a new one, its wheels at 0; the request with the old one is void. */
void vs_loop_guard_lost(struct vs_loop *loop);

/* The daemon ends: wheels 0 from now on. */
void vs_loop_end(struct vs_loop *loop);

/* The controller begins the run that the session has now, unless it has: a control step does the
 * same before. */
void vs_loop_begin(struct vs_loop *loop);

/* Why the wheels are held, or VS_CAUSE_NONE. */
enum vs_stop_cause vs_loop_cause(const struct vs_loop *loop, const struct vs_instant *now);

/* What is to be told now. With VS_TELL_NEWS t is filled but for what guard_link.h counts, what
 * radio.h tells, what the session fills in, and what of payload the table does not use. */
enum vs_telling vs_loop_telemetry(struct vs_loop *loop, const struct vs_instant *now,
                                  struct vs_telemetry *t);

/* When the host has to be told at the latest. */
uint64_t vs_loop_telemetry_ns(const struct vs_loop *loop);

/* 1 while the guard owes the answer to a PING: that it comes is all that matters. */
int vs_loop_is_pinging(const struct vs_loop *loop);

/* 1 while the guard's answer may lie unread: it is to a PING, and nothing has to be asked
 * before the next control step, which reads it. */
int vs_loop_is_patient(const struct vs_loop *loop, const struct vs_instant *now);

/* Base's clock: when vs_loop_request and vs_loop_telemetry have to be asked again. */
uint64_t vs_loop_wake_ns(const struct vs_loop *loop, const struct vs_instant *now);

#endif
