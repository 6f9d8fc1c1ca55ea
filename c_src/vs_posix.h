/* SPDX-License-Identifier: MIT */
/*
 * vs_posix.h - the POSIX edge of the library: clock, serial port, lock. The only
 * file of c_src that talks to an operating system.
 */
#ifndef VS_POSIX_H
#define VS_POSIX_H

#include "vs_io.h"

#ifdef __cplusplus
extern "C" {
#endif

/* CLOCK_MONOTONIC [ns]. */
uint64_t vs_posix_now_ns(void);

/* Milliseconds for poll() from now_ns until deadline_ns, rounded up: 0 if it has
 * passed, -1 (for ever) if deadline_ns is UINT64_MAX. */
int vs_posix_timeout_ms(uint64_t now_ns, uint64_t deadline_ns);

/* Closes fd in whatever program a child of this process becomes. */
void vs_posix_keep_from_children(int fd);

/*
 * Opens a serial port raw, 115200 baud 8N1, non-blocking, never as the controlling
 * terminal and kept from children, drops what it had buffered and holds its flock(). While another
 * process holds the lock it waits, at the longest wait_ns.
 * VS_OK and the descriptor in *fd, VS_ERR_LOCKED, or VS_ERR_IO with errno set.
 */
int vs_posix_open_serial(const char *path, uint64_t wait_ns, int *fd);

/* Lets io work on *fd. *fd has to outlive io. */
void vs_posix_io(struct vs_io *io, int *fd);

#ifdef __cplusplus
}
#endif

#endif
