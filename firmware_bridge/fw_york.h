/* SPDX-License-Identifier: MIT */
/*
 * fw_york.h - the microcontroller's end of York's register map (epuck_york.h), as
 * freestanding C. Quirks that are kept:
 * - the low byte of a write takes effect, its high byte 0, before the high byte has
 *   come; a loop copies registers to motors and LEDs every millisecond, so that it may
 *   see a number that nobody wrote;
 * - a third byte that is read holds the bus low until a reset; one byte that is read
 *   leaves its partner for the next read; a fourth byte that is written is refused;
 * - proximity is 0 and light 4095 until it was sensed: two sensors every 2.45 ms, from
 *   when sensing is switched on;
 * - a counter that is read while its low byte carries is wrong by 256 (on request).
 *
 * An e-puck2 with the same map (is_epuck2) is another program:
 * - a message is taken as a whole when it ends: nothing is torn;
 * - registers 0 and 1 answer one byte, and whatever is read beyond an answer is its last
 *   byte again; a register that does not answer leaves the answer before it;
 * - speeds read back as they were taken, at once; a thread applies them, but not after an
 *   error on the bus: then the next write is not applied, and reads back all the same;
 * - it always senses; proximity is never below 0, light is as measured: higher is darker.
 */
#ifndef FW_YORK_H
#define FW_YORK_H

#include <stddef.h>
#include <stdint.h>

#include "epuck_york.h"
#include "fw_body.h"
#include "fw_i2c.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    FW_YORK_LOOP_US = 1000,   /* [us] of the main loop */
    FW_YORK_FIRST_US = 350,   /* [us] from switching on to the first two sensors */
    FW_YORK_PAIR_US = 2450,   /* [us] from two sensors to the next two */
    FW_YORK_BOOT_US = 100000, /* [us] estimate: nobody acknowledges after a reset */
    FW_YORK_REGISTERS = 256,
    FW_YORK_MESSAGE_MAX = 32  /* [byte] an e-puck2 keeps of a message */
};

struct fw_york {
    struct fw_body body;
    struct fw_i2c_device device; /* to be put on a bus; the struct must not move then */
    uint32_t writes;             /* of registers, since power on */
    uint32_t torn;               /* speeds that the motors got and nobody wrote */
    uint8_t is_epuck2;           /* the owner writes, before anything else */
    uint32_t tear;               /* the owner writes: the n-th counter that is read from now
                                    is read while its low byte carries, 0 = not */
    uint64_t booted_us;          /* it acknowledges from then on */
    uint64_t lived_us;
    uint64_t sensing_us;         /* since when, FW_NEVER_US = not */
    uint16_t registers[FW_YORK_REGISTERS];
    uint8_t pointer;
    uint8_t has_left_over;       /* a read of one byte left its partner */
    uint8_t left_over;
    uint8_t incoming[2];         /* low, high, on their way to the register `pointer` */
    uint8_t expected;            /* bytes of them that will have come */
    uint8_t stored;              /* bytes of them that were stored */
    uint8_t dirty;               /* the loop has to look at the registers */
    uint64_t first_us;           /* when the low byte comes */
    /* of an e-puck2 */
    uint32_t dropped;            /* writes that were not applied */
    uint8_t had_error;
    uint8_t received[FW_YORK_MESSAGE_MAX];
    uint8_t answer[2];
    uint8_t answer_len;
};

/* Power on, long ago. */
void fw_york_init(struct fw_york *fw);

/* Reset at now_us. */
void fw_york_reset(struct fw_york *fw, uint64_t now_us);

/* Lives on to now_us. Returns 1 if the outputs may have changed since the last call
 * (body.outputs, body.applied_us), else 0. */
int fw_york_advance(struct fw_york *fw, uint64_t now_us);

/* When it pays to look again, UINT64_MAX if nothing is under way. */
uint64_t fw_york_due_us(const struct fw_york *fw);

#ifdef __cplusplus
}
#endif

#endif
