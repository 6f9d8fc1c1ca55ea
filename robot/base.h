/* SPDX-License-Identifier: MIT */
/*
 * base.h - a base: whatever turns wheels and lights LEDs below the Linux board. One kind of base is
 * one struct of functions in one file of its own and one line in base.c's table. No function blocks
 * for longer than 100 ms: its owner, the guard, answers in between.
 */
#ifndef VS_BASE_H
#define VS_BASE_H

#include <stddef.h>
#include <stdint.h>

#include "base_boards.h"
#include "base_body.h"
#include "base_reset.h"
#include "../c_src/vs_i2c.h"
#include "../c_src/vs_io.h"

#define VS_BASE_STATE_MAX 256  /* [byte] what a kind of base may keep */
#ifdef VSENSED_DRIVERS
#define VS_BASE_DEVICE_MAX 255 /* [byte] longest path of a device or bus, or command of a driver */
#else
#define VS_BASE_DEVICE_MAX 111
#endif
#define VS_BASE_LEDS 0x3FF     /* bits 0-7 ring, 8 body, 9 front */
#define VS_BASE_RGB_LEDS 4
#define VS_BASE_EXCHANGE_NS 30000000u /* [ns] longest exchange */
#define VS_BASE_LOCK_NS 2000000000u   /* [ns] for an earlier daemon's end */

struct vs_base_command {
    int16_t left_steps_s;  /* [step/s] */
    int16_t right_steps_s; /* [step/s] */
    uint16_t leds;         /* lit ones: bits 0-7 ring, 8 body, 9 front */
    struct vs_board_message message; /* for the range-and-bearing board, not for the base */
    uint8_t rgb[VS_BASE_RGB_LEDS][3]; /* red, green, blue of coloured LEDs, 0..255 */
};

/* What the base measured, in the order and scale that controller.h documents. */
struct vs_base_reading {
    int16_t prox[8];     /* [raw] ps0..ps7, higher is nearer */
    int16_t light[8];    /* [raw] ps0..ps7, higher is brighter */
    uint8_t blind;       /* 1: it has neither, both mean nothing */
    uint8_t battery_low; /* 0, 1 or 255 = unknown */
    uint16_t battery_mv; /* [mV] 0 = unknown */
    int16_t acceleration[3]; /* [raw] x, y, z; all 0: not measured */
    int16_t microphones[4];  /* [raw] all 0: not measured */
    uint8_t microphone_count;
    uint8_t has_steps;   /* 1: steps are counted */
    int32_t steps[2];    /* [step] of the left and right wheel, forwards, since the start */
    uint32_t step_nm;    /* [nm] way of a wheel per step */
    int16_t max_steps_s; /* [step/s] what its motors can do, 0: not known */
    uint8_t has_ground;  /* 1: it measures ground itself, without a board */
    uint8_t rgb_leds;    /* coloured LEDs that it has */
    int16_t ground[3];   /* [raw] as a board's */
    uint16_t distance_mm; /* [mm] ahead, 0: not measured yet */
    int16_t rates[3];    /* [1/EPUCK_IMU_DIGITS rad/s] x, y, z */
    uint8_t has_rates;   /* 0: they are not measured */
    uint8_t has_distance; /* 0: distance_mm is not measured at all */
    uint32_t age_us;     /* [us] how old it was when it came: driver.h */
    struct vs_board_reading boards; /* no base writes it: boards have processes of their own */
};

#define VS_BASE_OWN offsetof(struct vs_base_reading, boards) /* [byte] what the base says */

/* "mode=extension|bluetooth": one option of a kind of base; the first value is the
 * default. */
struct vs_base_choice {
    const char *name;          /* NULL ends a list of choices */
    const char *const *values; /* ended by NULL */
};

struct vs_base;
struct vs_base_config;

struct vs_base_ops {
    const char *name;   /* before the colon of --base */
    const char *help;   /* lines without the last newline */
    const char *device; /* an example */
    uint8_t on_i2c;     /* 1: the device is a bus that boards may sit on, too */
    const struct vs_base_choice *choices; /* at most VS_BASE_CHOICES, then NULL */

    /* Opens the device, prepares base->io or base->bus and sets base->body. What the
     * base does is unknown until recover gave VS_OK. VS_OK, VS_ERR_IO with errno set,
     * or VS_ERR_LOCKED. */
    int (*open)(struct vs_base *base, const struct vs_base_config *config);

    /* One step of finding the base in whatever state it is, wheels at 0 and LEDs
     * off at the end. VS_OK: found; VS_ERR_BUSY: call again; VS_ERR_SILENT: nothing
     * answered, calling again starts over; VS_ERR_IO, VS_ERR_HANGUP. */
    int (*recover)(struct vs_base *base);

    /* Commands and reads, in at most 30 ms. VS_OK: the base has answered, and as far
     * as its protocol can tell it does as commanded; VS_ERR_LATE: commanded, but
     * *reading is not written; VS_ERR_BUSY: not, or not surely, commanded: call again.
     * After any other error the base has to be recovered first. */
    int (*exchange)(struct vs_base *base, const struct vs_base_command *command,
                    struct vs_base_reading *reading);

    /* Clean end: wheels at 0, LEDs off, the base waits for its next host. As exchange. */
    int (*close)(struct vs_base *base);
};

/* Caller-owned; must not move once it is open. */
struct vs_base {
    const struct vs_base_ops *ops;
    const struct vs_base_body *body;
    struct vs_io io;      /* of a base behind a serial line */
    struct vs_i2c bus;    /* of a base on a bus */
    int fd;               /* of the device: guard and worker hold it */
    struct vs_reset reset;
    const char *news;     /* a phrase worth telling, for whoever owns the base; NULL: none */
    uint32_t resets;      /* of its microcontroller, as far as they were noticed */
    struct vs_boards boards;
    uint16_t counters[2]; /* of the wheels, as read last */
    int32_t steps[2];
    uint8_t counting;     /* 1: counters were read since the base was found */
    uint64_t until_ns;    /* by then the next command comes, or wheels rest: driver.h */
    union {
        uint64_t for_alignment;
        uint8_t bytes[VS_BASE_STATE_MAX];
    } state; /* of this kind of base, all zeros at open */
};

/* Opens what the configuration says, boards included. As ops->open; what could not be
 * opened is then in base->news. Nothing is asked of a board yet. */
int vs_base_open(struct vs_base *base, const struct vs_base_config *config);

/* ops->recover; where nothing answers a reset, too, if there is a GPIO for it. */
int vs_base_recover(struct vs_base *base);

/* ops->exchange with a command that the body can do. *reading keeps what was not measured. */
int vs_base_exchange(struct vs_base *base, const struct vs_base_command *command,
                     struct vs_base_reading *reading);

/* For an exchange: proximity, 0 where flickering light has made it negative, and light, which
 * e-pucks measure as most minus brightness, as brightness. */
void vs_base_see(const int16_t prox[8], const int16_t light[8], int16_t most,
                 struct vs_base_reading *reading);

/* For an exchange: what the accelerometer, or NULL, and so many microphones say. */
void vs_base_feel(const int16_t acceleration[3], const int16_t *microphones, int count,
                  struct vs_base_reading *reading);

/* For an exchange: adds up what the wheels' counters, which wrap, say. */
void vs_base_count(struct vs_base *base, const uint16_t counters[2],
                   struct vs_base_reading *reading);

extern const struct vs_base_ops *const vs_bases[]; /* every kind of this daemon, then NULL */

#endif
