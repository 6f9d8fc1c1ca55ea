/* SPDX-License-Identifier: MIT */
/*
 * vs_crash.h - where this process crashed, for whoever looks at its shared memory from outside:
 * places in the shared objects of one folder, which is where users' programs are built.
 */
#ifndef VS_CRASH_H
#define VS_CRASH_H

#include <stdint.h>

#define VS_CRASH_PLACES 8
#define VS_CRASH_PATH 512 /* [byte] longest path, with its zero */

/* Private to the process that crashes until it is dead. */
struct vs_crash {
    uint32_t count;                   /* places that there are, the innermost call first */
    char path[VS_CRASH_PATH];         /* of the shared object that they are in */
    uint64_t offset[VS_CRASH_PLACES]; /* [byte] of the instruction from the object's begin */
};

/* From now on SIGSEGV, SIGBUS, SIGFPE, SIGILL and SIGABRT note in *crash where they happened, and
 * end the process as they do without. crash stays the caller's, of shared memory; folder, a path
 * that ends with '/', too. 0; -1: this C library does not say who called whom: nothing is done. */
int vs_crash_watch(struct vs_crash *crash, const char *folder);

#endif
