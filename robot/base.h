/* SPDX-License-Identifier: MIT */
/*
 * base.h - a base: whatever turns wheels and lights LEDs below the Linux board.
 * One base protocol is one struct of functions in one file (base_argos.c). No
 * function blocks for longer than 100 ms, recovery goes in steps, so that its
 * owner, the guard, can answer in between.
 */
#ifndef VS_BASE_H
#define VS_BASE_H

#include <stddef.h>
#include <stdint.h>

#include "../c_src/vs_io.h"

#define VS_BASE_FRAME_MAX 128 /* [byte] largest answer of any base */
#define VS_BASE_LEDS 0x3FF    /* bits 0-7 ring, 8 body, 9 front */

struct vs_base_command {
    int16_t left_steps_s;  /* [step/s] -1000..1000 */
    int16_t right_steps_s; /* [step/s] -1000..1000 */
    uint16_t leds;         /* lit ones: bits 0-7 ring, 8 body, 9 front */
};

/* What the base measured, in the order and scale that controller.h documents. */
struct vs_base_reading {
    int16_t prox[8];     /* [raw] ps0..ps7, higher is nearer */
    int16_t light[8];    /* [raw] ps0..ps7, higher is brighter */
    uint8_t battery_low; /* 0, 1 or 255 = unknown */
    uint16_t battery_mv; /* [mV] 0 = unknown */
};

struct vs_base;

struct vs_base_ops {
    const char *name; /* before the colon of --base */
    const char *help; /* one line */

    /* Opens the device and prepares base->io. The base's state is unknown until
     * recover gave VS_OK. VS_OK, VS_ERR_IO with errno set, or VS_ERR_LOCKED. */
    int (*open)(struct vs_base *base, const char *device);

    /* One step of finding the base in whatever state it is, wheels at 0 and LEDs
     * off at the end. VS_OK: found; VS_ERR_BUSY: call again; VS_ERR_SILENT: nothing
     * answered, calling again starts over; VS_ERR_IO, VS_ERR_HANGUP. */
    int (*recover)(struct vs_base *base);

    /* Commands and reads, in at most 30 ms. VS_OK; VS_ERR_LATE: commanded, but
     * *reading is not written; VS_ERR_BUSY: nothing was done. After any other
     * error the base has to be recovered first. */
    int (*exchange)(struct vs_base *base, const struct vs_base_command *command,
                    struct vs_base_reading *reading);

    /* Clean end: wheels at 0, LEDs off, the base waits for its next host. As exchange. */
    int (*close)(struct vs_base *base);
};

/* Caller-owned; must not move once it is open. */
struct vs_base {
    const struct vs_base_ops *ops;
    struct vs_io io;
    int fd; /* of the device: both processes hold it */
    /* the protocol's own */
    uint8_t phase;
    uint8_t fed;         /* bytes fed without an answer */
    uint8_t proofs;      /* in a row that it stands where we think */
    size_t got;          /* bytes of the present answer */
    uint64_t written_ns; /* when the command before it was written */
    uint8_t frame[VS_BASE_FRAME_MAX];
};

/* Every base protocol of this daemon, ended by NULL. */
extern const struct vs_base_ops *const vs_bases[];
extern const struct vs_base_ops vs_base_argos;

/* Splits "argos:/dev/ttyS0": returns the base's functions and points *device at
 * what follows the colon; NULL if there is no such base, or no device. */
const struct vs_base_ops *vs_base_find(const char *text, const char **device);

#endif
