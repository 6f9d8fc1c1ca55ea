/* SPDX-License-Identifier: MIT */
#define _GNU_SOURCE /* dladdr */

#include "vs_crash.h"

#include <signal.h>
#include <stddef.h>
#include <string.h>

#if defined(__GLIBC__)
#include <dlfcn.h>
#include <execinfo.h>

#define FRAMES 48
#define HANDLER_FRAMES 2 /* this handler's own, and the one from which the kernel has it called */
#define STACK_BYTES 65536

/* A signal handler gets no argument: this is the one way to tell it where to write. */
static struct vs_crash *watched;
static const char *programs;
static char stack[STACK_BYTES]; /* an endless recursion has used up the other one */

static const int crashes[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};

/* The address that a call returns to is behind it: the one before belongs to the call. */
static void note(const char *address, int is_call)
{
    struct vs_crash *crash = watched;
    Dl_info object;

    if (crash->count == VS_CRASH_PLACES || dladdr(address, &object) == 0 ||
        strncmp(object.dli_fname, programs, strlen(programs)) != 0 ||
        strlen(object.dli_fname) >= VS_CRASH_PATH)
        return;
    if (crash->count == 0)
        memcpy(crash->path, object.dli_fname, strlen(object.dli_fname) + 1);
    else if (strcmp(crash->path, object.dli_fname) != 0)
        return;
    crash->offset[crash->count] =
        (uint64_t)(address - (const char *)object.dli_fbase) - (is_call ? 1u : 0u);
    crash->count++;
}

/* The signal that it raises comes when it returns, and ends the process: see SA_RESETHAND. */
static void handle(int number)
{
    void *frames[FRAMES];
    int count = backtrace(frames, FRAMES);
    int i;

    for (i = HANDLER_FRAMES; i < count; i++)
        note(frames[i], i > HANDLER_FRAMES);
    raise(number);
}

int vs_crash_watch(struct vs_crash *crash, const char *folder)
{
    struct sigaction action;
    stack_t other;
    void *frame;
    size_t i;

    memset(crash, 0, sizeof *crash);
    watched = crash;
    programs = folder;
    (void)backtrace(&frame, 1); /* loads what it needs, which a handler must not */
    memset(&other, 0, sizeof other);
    other.ss_sp = stack;
    other.ss_size = sizeof stack;
    sigaltstack(&other, NULL);
    memset(&action, 0, sizeof action);
    sigemptyset(&action.sa_mask);
    action.sa_flags = (int)((unsigned)SA_RESETHAND | (unsigned)SA_ONSTACK);
    action.sa_handler = handle;
    for (i = 0; i < sizeof crashes / sizeof crashes[0]; i++)
        sigaction(crashes[i], &action, NULL);
    return 0;
}

#else

int vs_crash_watch(struct vs_crash *crash, const char *folder)
{
    (void)folder;
    memset(crash, 0, sizeof *crash);
    return -1;
}

#endif
