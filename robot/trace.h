/* SPDX-License-Identifier: MIT */
/*
 * trace.h - a test aid: one line of text per control step, written whole, so that a
 * killed daemon leaves no half line but the last. Never waits: a line that a full pipe
 * does not take is dropped. Times are [ns]; "local" is the
 * session's clock, which may be negative with --clock-offset-ns.
 *
 *   step K timestep T run R now_ns N rx_ns X capture_ns C age_ns A bound_ns B stale S
 *   left L right R leds D values NAME=HEX,...
 *
 * N local, at the controller's call; X local, first receipt of the newest capture; C
 * host's clock; A the daemon's estimate of that capture's age at N, B its bound, -1 =
 * unknown; L, R [step/s] and D after safety; HEX the sensor's bytes, - = never measured.
 */
#ifndef VS_TRACE_H
#define VS_TRACE_H

#include "loop.h"

/* Makes the file and writes the line that names the columns. Returns its descriptor,
 * or -1 with errno set. */
int vs_trace_open(const char *path);

/* Appends the loop's newest step. Returns 0; 1: dropped, the file takes nothing now;
 * -1 with errno set: of the line a part may be there, without an end. */
int vs_trace_step(int fd, const struct vs_loop *loop);

#endif
