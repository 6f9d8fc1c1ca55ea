/* SPDX-License-Identifier: MIT */
/* guard_process.h - the guard's mind (guard.h) between a socket, a signal and a base. */
#ifndef VS_GUARD_PROCESS_H
#define VS_GUARD_PROCESS_H

#include "guard.h"

#define VS_GUARD_KEPT 8 /* lines for a worker that does not listen */

enum {
    VS_GUARD_STOPPED = 0, /* the base surely stands still and was handed back */
    VS_GUARD_UNSURE = 1,  /* it did not answer at the end */
    VS_GUARD_GONE = 2     /* it hung up */
};

/* What is left at the end. */
struct vs_guard_rest {
    const char *news[VS_GUARD_KEPT]; /* untold lines, the oldest first */
    size_t count;
    int hung;                        /* 1: the worker lives, but hangs */
    int stopped;                     /* 1: the base surely stands still */
};

/*
 * Serves requests on socket (SOCK_SEQPACKET) until the worker is gone or hangs, asks for the
 * end, or signals_fd gets readable. found: the base was just recovered. refused: as
 * vs_rights_take says, for the worker. It writes no file and no line: a log on a card may
 * block for seconds. Returns the exit status of the process, one of the above.
 */
int vs_guard_process(int socket, int signals_fd, struct vs_base *base, int found,
                     unsigned int refused, struct vs_guard_rest *rest);

#endif
