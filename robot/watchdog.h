/* SPDX-License-Identifier: MIT */
/*
 * watchdog.h - the board's hardware watchdog, /dev/watchdog: it restarts the board seconds
 * after nobody feeds it any more, which stops no wheels in 450 ms. The worker opens it before
 * the guard is forked, the guard feeds it, and the worker closes it when all ended well; after
 * any other end it goes on counting until the next daemon opens it.
 */
#ifndef VS_WATCHDOG_H
#define VS_WATCHDOG_H

#include <stdint.h>

#define VS_WATCHDOG_S 10               /* [s] asked for; a driver may take its own */
#define VS_WATCHDOG_FEED_NS 1000000000u /* [ns] from one feeding to the next */

/* Opens it, which starts it. One that cannot be had is told, and done without. NULL: none. */
void vs_watchdog_open(const char *path);

/* The guard goes round: feeds it if it is time. */
void vs_watchdog_feed(uint64_t now_ns);

/* Switches it off, if that was an orderly end. */
void vs_watchdog_end(int orderly);

#endif
