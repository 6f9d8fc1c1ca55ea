/* SPDX-License-Identifier: MIT */
/* random.h - bytes from the system's generator. */
#ifndef VS_RANDOM_H
#define VS_RANDOM_H

#include <stddef.h>

/* Fills bytes from /dev/urandom (getrandom is younger than the oldest kernel that counts
 * here). Returns 0, or -1 and errno. */
int vs_random_fill(void *bytes, size_t len);

#endif
