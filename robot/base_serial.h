/* SPDX-License-Identifier: MIT */
/*
 * base_serial.h - what bases on a serial line have in common: every request has one answer
 * of known length, which may come late, and nothing else may be on the line. Pure.
 */
#ifndef VS_BASE_SERIAL_H
#define VS_BASE_SERIAL_H

#include "base.h"

#define VS_SERIAL_ANSWER_MAX 72 /* [byte] longest answer */

enum {
    VS_SERIAL_UNKNOWN = 0, /* nobody knows what the far end waits for */
    VS_SERIAL_READY,       /* it waits for a request and nothing is unread */
    VS_SERIAL_OWED,        /* it got a request, its answer is not complete */
    VS_SERIAL_QUIET,       /* recovery: waiting for silence */
    VS_SERIAL_OWN          /* the first of a base's own phases of recovery */
};

/* Begins the state of such a base. */
struct vs_serial {
    uint8_t phase;
    uint8_t wanted;      /* [byte] of an answer */
    uint32_t owed_ns;    /* [ns] an answer that is later than this is none */
    size_t got;          /* bytes of the present answer, or read while draining */
    uint64_t written_ns; /* when the request before it was written */
    uint8_t answer[VS_SERIAL_ANSWER_MAX];
};

static inline struct vs_serial *vs_serial_of(struct vs_base *base)
{
    return (struct vs_serial *)(void *)base->state.bytes;
}

uint64_t vs_serial_now(const struct vs_base *base);

/* Writes bytes, whose answer is the present one from now on. Errors: as of vs_io.write. */
int vs_serial_write(struct vs_base *base, const uint8_t *buf, size_t len, uint64_t deadline_ns);

/* Reads on until the answer is complete (VS_OK) or time is up (VS_ERR_BUSY). */
int vs_serial_collect(struct vs_base *base, uint64_t deadline_ns);

/* The same for an answer that is owed. VS_ERR_BUSY: it may still come; VS_ERR_SILENT: it
 * does not. */
int vs_serial_await(struct vs_base *base, uint64_t deadline_ns);

/* VS_OK if the far end is ready and nothing is unread; else VS_ERR_SILENT, VS_ERR_GARBLED. */
int vs_serial_is_clear(struct vs_base *base);

/* Reads whatever comes, for longest_ns, counts it in got and shows it to see, if there is
 * one. VS_OK: it was silent for quiet_ns; VS_ERR_BUSY: not yet. */
int vs_serial_drain(struct vs_base *base, uint64_t quiet_ns, uint64_t longest_ns,
                    void (*see)(struct vs_base *base, const uint8_t *buf, size_t len));

#endif
