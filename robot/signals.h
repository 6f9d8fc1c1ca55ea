/* SPDX-License-Identifier: MIT */
/* signals.h - whatever tells a process to end, as a descriptor that poll() can wait for. */
#ifndef VS_SIGNALS_H
#define VS_SIGNALS_H

/* From now on SIGTERM, SIGINT, SIGHUP and SIGQUIT make *fd readable instead of ending
 * the process, SIGPIPE is ignored, and SIGCHLD is not, whatever the parent had it do: a
 * child's exit status is wanted. Called again, in a forked child, it starts a new
 * descriptor of the child's own. Returns 0, or -1 with errno set. */
int vs_signals_open(int *fd);

/* 1 if such a signal has come, without a system call. */
int vs_signals_told(void);

/* From now on Ctrl-Z does not stop this process: the guard has to stop the wheels of a
 * worker that it did stop. */
void vs_signals_stay_awake(void);

/* From now on what tells a process to end, or to stop, does nothing: one that ends when its
 * parent does. */
void vs_signals_ignore(void);

/* Ends what vs_signals_stay_awake did: it would outlive an exec. */
void vs_signals_may_sleep(void);

/* Forks, with a socket of packets between the two processes: *socket is the own end. Returns as
 * fork(). In the child the signals are held back until vs_signals_unblock: it has none of its
 * parent's ways to deal with them. */
long vs_signals_fork(int *socket);
void vs_signals_unblock(void);

/* A controller's fork(): its compiler is told to call it so (vsense/robots/compiling.py). The
 * child has nothing of the daemon's, neither descriptors nor ways to deal with signals, and ends
 * with its parent: what it held open, no other daemon could have. */
int vs_controller_fork(void);

#endif
