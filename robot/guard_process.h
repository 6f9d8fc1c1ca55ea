/* SPDX-License-Identifier: MIT */
/* guard_process.h - the guard's mind (guard.h) between a socket, a signal and a base. */
#ifndef VS_GUARD_PROCESS_H
#define VS_GUARD_PROCESS_H

#include "guard.h"

enum {
    VS_GUARD_STOPPED = 0, /* the base surely stands still and was handed back */
    VS_GUARD_UNSURE = 1,  /* it did not answer at the end */
    VS_GUARD_GONE = 2     /* it hung up */
};

/*
 * Serves requests on socket (SOCK_SEQPACKET) until the worker is gone, asks for the
 * end, or signals_fd gets readable. found: the base was just recovered.
 * Returns the exit status of the process, one of the above.
 */
int vs_guard_process(int socket, int signals_fd, struct vs_base *base, int found);

#endif
