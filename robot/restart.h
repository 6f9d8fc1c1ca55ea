/* SPDX-License-Identifier: MIT */
/*
 * restart.h - a daemon anew, after its worker hung. A service does that itself (the systemd
 * unit and the init script say so with VS_SERVICE in the environment); without one the guard,
 * which guards nothing any more, becomes the new daemon. So there are never two.
 */
#ifndef VS_RESTART_H
#define VS_RESTART_H

#define VS_SERVICE "VSENSED_SERVICE"

/* 1 if a service starts the daemon again when it ends. */
int vs_restart_by_service(void);

/* Ends a process that hangs, and waits for its end, at the longest 1 s; ended says when it
 * has (poll() for POLLHUP). Returns 1 if it has ended. */
int vs_restart_end(long pid, int ended);

/* Becomes the program of this process, with the same arguments. Returns if that fails, with
 * errno set. */
void vs_restart(char *const argv[]);

#endif
