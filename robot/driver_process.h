/* SPDX-License-Identifier: MIT */
/*
 * driver_process.h - a driver: a program of any language that turns the wheels. Whoever owns the
 * base starts it, and may end it; guard and worker share one line to it, so that the one goes on
 * with the driver of the other. It reads orders from its standard input and writes reports to its
 * standard output.
 */
#ifndef VS_DRIVER_PROCESS_H
#define VS_DRIVER_PROCESS_H

#include "driver_record.h"

#define VS_DRIVER_AGAIN_NS UINT64_C(2000000000) /* [ns] from one's start to the next one's */
#define VS_DRIVER_KILL_NS 1000000000u /* [ns] a killed one that nobody buried counts as ended */

/* In memory that guard and worker have in common. All zeros: there is no driver. */
struct vs_driver {
    int32_t pid;          /* 0: none */
    int32_t how;          /* the last one's status of waitpid, -1: not known */
    uint64_t started_ns;  /* board's clock, of the newest one; 0: there was none */
    uint64_t killed_ns;   /* board's clock, 0: it was not */
    uint64_t sent_ns;     /* its newest order */
    uint64_t order_ns;    /* the newest that it said to follow, 0: none yet */
    uint64_t asked_ns;    /* it owes a report since then, at the earliest */
    uint64_t rest_ns;     /* the first order of those that say: rest; 0: it shall drive */
    int64_t way_um[2];    /* as it said last */
    uint32_t steps[2];    /* of all drivers together; they wrap */
    int32_t rest_nm[2];   /* of a step */
    uint8_t counting;     /* 1: way_um is this driver's */
    uint32_t got;
    uint8_t buf[VS_DRIVER_REPORT_LEN];
};

/* The line's ends, and that memory. */
struct vs_driver_line {
    const char *command;
    struct vs_driver *driver;
    int own, theirs;
};

/* VS_OK, or VS_ERR_IO with errno set. */
int vs_driver_open(struct vs_driver_line *line, const char *command);

/* CLOCK_MONOTONIC [ns]. */
uint64_t vs_driver_clock_ns(void);

/* 1: a driver runs; looks whether it has ended since, then its end is in driver->how. */
int vs_driver_runs(struct vs_driver_line *line, uint64_t now_ns);

/* Starts one on an empty line. VS_OK, or VS_ERR_IO with errno set. */
int vs_driver_start(struct vs_driver_line *line, uint64_t now_ns);

/* Ends it and what it has started, at once. */
void vs_driver_kill(struct vs_driver_line *line, uint64_t now_ns);

#endif
