/* SPDX-License-Identifier: MIT */
/*
 * vs_io.h - the one seam between a base's protocol and its line: a struct of
 * functions. The daemon fills it from a serial port (vs_posix.h), tests from
 * memory and virtual time. Times are [ns] of one monotonic clock.
 */
#ifndef VS_IO_H
#define VS_IO_H

#include <stddef.h>
#include <stdint.h>

#include "vs_err.h"

struct vs_io {
    void *context; /* handed to every function */

    uint64_t (*now_ns)(void *context);

    /* Waits for bytes, at the longest until deadline_ns (past: looks once).
     * Returns how many were read, 0 if time is up, or VS_ERR_IO, VS_ERR_HANGUP. */
    int (*read)(void *context, uint8_t *buf, size_t cap, uint64_t deadline_ns);

    /* Hands all len bytes to the line. VS_OK, VS_ERR_IO (also if the line did not
     * take them until deadline_ns) or VS_ERR_HANGUP. */
    int (*write)(void *context, const uint8_t *buf, size_t len, uint64_t deadline_ns);

    /* The next read wants so many bytes together: it may wait for all of them, and give
     * fewer with its deadline only. Spares a slow line's wake-ups. NULL: cannot. */
    void (*expect)(void *context, size_t len);
};

#endif
