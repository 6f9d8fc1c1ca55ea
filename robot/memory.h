/* SPDX-License-Identifier: MIT */
/*
 * memory.h - memcpy and memset by words. What comes with the pinned cross compiler goes byte
 * by byte when it is told to build small, and most of a control step would be spent in it.
 * memory.c gives these two their standard names where the C library is not the GNU one.
 */
#ifndef VS_MEMORY_H
#define VS_MEMORY_H

#include <stddef.h>

/* As memcpy of the C standard: the two must not overlap. */
void *vs_memory_copy(void *restrict to, const void *restrict from, size_t len);

/* As memset of the C standard. */
void *vs_memory_set(void *to, int value, size_t len);

#endif
