/* SPDX-License-Identifier: MIT */
/*
 * guard_link.h - the worker's end of the guard: starts the process, talks to it, and
 * replaces it when it dies or falls silent. Replacing it stops the wheels first,
 * through the worker's own descriptor of the base.
 */
#ifndef VS_GUARD_LINK_H
#define VS_GUARD_LINK_H

#include "guard.h"
#include "guard_process.h"

#define VS_GUARD_SILENCE_NS 150000000u /* [ns] a guard that says nothing is dead */

struct vs_guard_link {
    struct vs_base *base;
    const int *const *foreign; /* descriptors that the child must not hold open; -1 = none */
    size_t foreign_count;
    char *const *argv;      /* of this daemon */
    const void *spare;      /* the worker's memory that the guard never uses */
    size_t spare_len;
    long dying;             /* a guard that was killed and has not ended yet, 0 = none */
    long pid;               /* 0: no guard */
    int socket;
    uint32_t number;        /* of the newest request */
    uint8_t waiting;        /* for its reply */
    uint64_t heard_ns;      /* newest sign of life */
    uint32_t restarts;
    uint32_t base_errors;   /* of all guards so far */
    uint32_t errors_before; /* of all guards but this one */
    int status;             /* exit status of the last guard that ended by itself, -1 = none */
};

/* Forks the guard. found: the base was just recovered. Returns 0, or -1 with errno. */
int vs_guard_link_start(struct vs_guard_link *link, int found);

/* Sends a request; its number is filled in here. */
void vs_guard_link_send(struct vs_guard_link *link, struct vs_guard_request *request);

/* 1 and a reply, 0 if there is none yet, -1 if the guard has ended. */
int vs_guard_link_receive(struct vs_guard_link *link, struct vs_guard_reply *reply);

/* When a guard that still owes its reply counts as dead, UINT64_MAX if it owes none. */
uint64_t vs_guard_link_deadline_ns(const struct vs_guard_link *link);

/* The worker itself was held up for late_ns: the guard's silence proves nothing. */
void vs_guard_link_excuse(struct vs_guard_link *link, uint64_t late_ns);

/* Ends what is left of the guard: SIGKILL unless it ended by itself. One that a driver keeps
 * from dying is not waited for. */
void vs_guard_link_kill(struct vs_guard_link *link);

/* Stops the base through the worker's own descriptor, while there is no guard.
 * VS_OK, or the error of the base's recovery. */
int vs_guard_link_stop_base(struct vs_guard_link *link);

#endif
