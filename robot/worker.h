/* SPDX-License-Identifier: MIT */
/*
 * worker.h - the daemon's first process: one poll() loop around network, guard and
 * control loop. Single-threaded; no memory but this struct.
 */
#ifndef VS_WORKER_H
#define VS_WORKER_H

#include "board_link.h"
#include "guard_link.h"
#include "loop.h"
#include "net.h"
#include "options.h"
#include "radio.h"
#include "talk.h"

#define VS_WORKER_FOREIGN (4 + VS_BOARDS)

struct vs_worker {
    const struct vs_options *options;
    struct vs_base base;
    struct vs_guard_link guard;
    struct vs_board_links boards;
    struct vs_radio radio;
    struct vs_net net; /* from here on the guard uses nothing */
    struct vs_session session;
    struct vs_loop loop;
    int signals_fd;
    int trace_fd;      /* -1: none */
    const int *foreign[VS_WORKER_FOREIGN]; /* descriptors that no guard must hold */
    struct vs_instant now; /* read once after each wait, and after what takes long */
    uint64_t round_ns; /* when this round of the loop began */
    uint64_t late_ns;  /* how late that was */
    uint8_t guard_spoke; /* poll() says so */
    uint8_t trace_full; /* lines of the trace are being dropped */
    uint8_t ended;     /* the base was handed back */
    int status;        /* exit status once ended */
    const char *why;   /* once ended: one phrase */
    struct vs_talk talk;
    /* Large, and mostly never written: last, so that no page is written for what comes after. */
    union vs_controller_state state;
};

/* Runs the daemon. *w is all zeros, which nobody need write: pages that nobody touches cost a
 * board no memory. Returns its exit status: 0 after a signal, 1 if the base is gone
 * or cannot be opened, 2 if the controller or the address cannot be used. */
int vs_worker_run(struct vs_worker *w, const struct vs_options *options);

#endif
