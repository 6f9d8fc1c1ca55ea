/* SPDX-License-Identifier: MIT */
/*
 * guard_rights.h - what lets a process stop the wheels while the board is short of memory or
 * of time: its memory is never swapped out or read anew from a slow card, it is the last that
 * the kernel ends for want of memory, and it goes before all ordinary processes. Each is
 * tried; what the system refuses is told, and the guard works without it. The user's controller
 * runs with no other rights of root.
 */
#ifndef VS_GUARD_RIGHTS_H
#define VS_GUARD_RIGHTS_H

#include <stddef.h>

enum {
    VS_RIGHT_MEMORY = 1, /* program, data and stack stay in memory */
    VS_RIGHT_OOM = 2,    /* the least out-of-memory score */
    VS_RIGHT_TIME = 4    /* real-time priority */
};

#define VS_RIGHTS_TEXT 120 /* [byte] for vs_rights_text */

/* Takes all of them. spare: so many bytes of the program's data need no place in memory.
 * Returns which the system refused, 0 = none. */
unsigned int vs_rights_take(const void *spare, size_t spare_len);

/* An ordinary process again, but for the memory. */
void vs_rights_give_back(void);

/* Gives up, for good and for all that this process starts, every capability but those that
 * vs_rights_take uses; no program that it starts gets others. 0, or -1 with errno. */
int vs_rights_drop(void);

/* "without locked memory, real-time priority" */
void vs_rights_text(unsigned int refused, char text[VS_RIGHTS_TEXT]);

#endif
