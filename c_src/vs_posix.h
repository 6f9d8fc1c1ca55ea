/* SPDX-License-Identifier: MIT */
/*
 * vs_posix.h - the POSIX edge of the library: clock, waiting, lock, serial port. Beside
 * it only vs_i2c_posix.h talks to an operating system.
 */
#ifndef VS_POSIX_H
#define VS_POSIX_H

#include "vs_io.h"

#ifdef __cplusplus
extern "C" {
#endif

/*
 * The board's clock [ns], read now: CLOCK_MONOTONIC_RAW, on which NTP has no influence, the
 * same for all processes. Where the kernel has none (before 2.6.28) it is CLOCK_MONOTONIC.
 */
uint64_t vs_posix_now_ns(void);

#ifdef VSENSED_SLOW_CLOCK
/* From now on this process's clock, and what waits on it, goes at permille / 1000 (1 to 1000) of
 * the board's: for a lab that is slower than real time. Before its first reading. Only a host's
 * own build has it: a robot with a slow clock would stop late. */
void vs_posix_slow(uint32_t permille);
#endif

/* 1: it is CLOCK_MONOTONIC, whose rate NTP changes. */
int vs_posix_clock_is_slewed(void);

/* The newest reading of this process's clock, without a system call: the time since is what
 * the process computed. Whatever waits (vs_posix_wait, a bus's transfer) reads it anew. */
uint64_t vs_posix_recent_ns(void);

/* Milliseconds for poll() from now_ns until deadline_ns, rounded up: 0 if it has
 * passed, -1 (for ever) if deadline_ns is UINT64_MAX. */
int vs_posix_timeout_ms(uint64_t now_ns, uint64_t deadline_ns);

/* Closes fd in whatever program a child of this process becomes. */
void vs_posix_keep_from_children(int fd);

/* Closes all such descriptors, in a child that becomes no other program. */
void vs_posix_close_kept(void);

/* Closes all descriptors of this process but 0 to 2 and these two (-1: none). */
void vs_posix_close_but(int one, int other);

/* Waits until fd is ready for poll()'s events, at the longest until deadline_ns (past:
 * looks once). VS_OK, VS_ERR_BUSY: time is up, VS_ERR_HANGUP, VS_ERR_IO. */
int vs_posix_wait(int fd, short events, uint64_t deadline_ns);

/* Takes fd's flock(). While another process holds it this one waits, at the longest
 * wait_ns. VS_OK, VS_ERR_LOCKED, or VS_ERR_IO with errno set. */
int vs_posix_lock(int fd, uint64_t wait_ns);

/*
 * Opens a serial port raw, 8N1 at 115200 or 230400 baud, non-blocking, never as the
 * controlling terminal and kept from children, drops what it had buffered and takes
 * its lock.
 * VS_OK and the descriptor in *fd, VS_ERR_ARGUMENT: another baud, VS_ERR_LOCKED, or
 * VS_ERR_IO with errno set.
 */
int vs_posix_open_serial(const char *path, uint32_t baud, uint64_t wait_ns, int *fd);

/* Lets io work on *fd, the one serial port that this process has open. *fd has to outlive io. */
void vs_posix_io(struct vs_io *io, int *fd);

/* Another process has used the port since: how it was left nobody here knows. */
void vs_posix_take_over(void);

#ifdef __cplusplus
}
#endif

#endif
