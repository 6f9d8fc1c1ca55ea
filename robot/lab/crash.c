/* SPDX-License-Identifier: MIT */
/*
 * crash.c - part of daemons that are built for the lab, on this machine, and of no robot's: one
 * that crashes writes who called whom to its standard error, of which the lab tells the line.
 */
#include <signal.h>
#include <stddef.h>

#if defined(__GLIBC__)
#include <execinfo.h>

#define FRAMES 32
#define STANDARD_ERROR 2

static const int crashes[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};

/* The signal that it raises comes when it returns, and ends the process: see SA_RESETHAND. */
static void handle(int number)
{
    void *frames[FRAMES];
    int count = backtrace(frames, FRAMES);

    backtrace_symbols_fd(frames, count, STANDARD_ERROR);
    raise(number);
}

__attribute__((constructor)) static void watch(void)
{
    struct sigaction action;
    void *frame;
    size_t i;

    (void)backtrace(&frame, 1); /* loads what it needs, which a handler must not */
    sigemptyset(&action.sa_mask);
    action.sa_flags = (int)SA_RESETHAND;
    action.sa_handler = handle;
    for (i = 0; i < sizeof crashes / sizeof crashes[0]; i++)
        sigaction(crashes[i], &action, NULL);
}
#endif
