/* SPDX-License-Identifier: MIT */
/*
 * robot_life.h - the worker's mind and the guard's together, millisecond by millisecond on
 * virtual time, and a base that answers late or not at all, for the tests of loop.h.
 */
#ifndef ROBOT_LIFE_H
#define ROBOT_LIFE_H

#include <string.h>

#include "loop.h"
#include "robot_check.h"

#define MS UINT64_C(1000000)
#define TIMESTEP_NS (100 * MS)
#define EXCHANGE_NS (8 * MS)
#define LATE_NS (30 * MS)    /* an exchange without its answer */
#define SILENT_NS (70 * MS)  /* then the wait for it */
#define RECOVER_NS (60 * MS) /* then the base is found again, wheels 0 */

struct seen {
    int inits;
    int steps;
    int polluted;
};

struct world {
    struct vs_session session;
    struct vs_loop loop;
    struct vs_guard guard;
    struct seen state;
    struct vs_instant now;
    struct vs_base_command base; /* what the wheels do */
    uint64_t timestep_ns;
    uint32_t fault_one_in;       /* exchanges without an answer, 0 = none */
    int fault;                   /* the present one is such */
    int16_t max_steps_s;         /* that its readings tell, 0 = nothing */
    int homed;                   /* the host has wanted the robot to drive home */
    int unapplied;               /* the base did not understand the last one */
    uint64_t answer_ns;          /* the base's exchange is over then, 0 = none */
    enum vs_guard_action action;
    uint32_t random;
    uint64_t fresh_ns;           /* newest frame whose capture advanced */
    uint64_t wished_ns;          /* when the host last forbade motion, 0 = it wants it */
    uint64_t telemetry_ns;
    uint32_t told_cause;         /* by the newest telemetry that was no copy */
    uint32_t told_run;
    int copied;                  /* the newest telemetry was one */
    uint64_t last_step_ns;
    uint64_t begun_ns;           /* when that step began */
    uint32_t steps;
};

extern int ended; /* calls of the controller's end since `begin` */

/* A robot that has no session yet. */
void begin(struct world *w, uint32_t seed);

/* WELCOME came. */
void open_session(struct world *w);

/* A STATE arrives, as vs_session would show it. */
void receive(struct world *w, int advances);

/* What the host wants from now on. */
void wish(struct world *w, uint8_t wanted);

/* 1 if the wheels turn. */
int turning(const struct world *w);

/* One millisecond; all that must hold always is checked. */
void live(struct world *w);

/* The host is silent meanwhile. */
void live_for(struct world *w, uint64_t ns);

/* A host as it should be, for ns. */
void good_host(struct world *w, uint64_t ns);

#endif
