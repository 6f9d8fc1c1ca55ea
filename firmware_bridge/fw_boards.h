/* SPDX-License-Identifier: MIT */
/*
 * fw_boards.h - the boards beside the microcontroller (epuck_boards.h), as freestanding
 * C: ground sensors, and range and bearing with the quirks of its registers:
 * - a second byte that is read is that of the first register again;
 * - only reading register 0 takes a message out of the queue of 10, and what was taken
 *   stays until the next one is;
 * - with the stock firmware a message has 16 bits and nothing else can be set.
 * IRIDIA's RGB LEDs, which take 9 bytes and answer nothing. And the Pi-puck's converter: it holds
 * the newest conversion, of whatever channel was asked for.
 */
#ifndef FW_BOARDS_H
#define FW_BOARDS_H

#include <stddef.h>
#include <stdint.h>

#include "epuck_boards.h"
#include "fw_i2c.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { FW_GROUND_REGISTERS = 21 };

struct fw_ground {
    struct fw_i2c_device device; /* to be put on a bus; the struct must not move then */
    int16_t ground[3];           /* the owner writes: left, centre, right, 0..1023 */
    uint8_t pointer;
};

struct fw_rab {
    struct fw_i2c_device device; /* to be put on a bus; the struct must not move then */
    uint8_t is_stock;            /* the owner writes: 1 = GCtronic's firmware, 2 bytes only */
    uint32_t sent;               /* messages sent since power on */
    uint32_t sent_number;        /* the newest one, as many bits as a message has */
    uint64_t sent_us;
    uint32_t overflowed;         /* messages that found the queue full */
    uint8_t bits;                /* of a message */
    uint8_t power;
    uint8_t on_robot;
    uint32_t light_stored;       /* how often */
    uint8_t pointer;
    uint32_t number;             /* being put together */
    struct epuck_rab_message taken;
    struct epuck_rab_message queue[EPUCK_RAB_QUEUE];
    uint32_t queue_read;
    uint32_t queue_count;
};

struct fw_rgb {
    struct fw_i2c_device device; /* to be put on a bus; the struct must not move then */
    uint8_t rgb[EPUCK_RGB_LEDS][3]; /* red, green, blue of each LED */
    uint32_t writes;
};

struct fw_adc {
    struct fw_i2c_device device; /* to be put on a bus; the struct must not move then */
    uint16_t channels_mv[2];     /* [mV] the owner writes: battery, another one */
    uint16_t settings;
    uint8_t value[2];
    uint8_t pointer;
};

/* Power on: dark. */
void fw_rgb_init(struct fw_rgb *fw);

/* Power on: no batteries. */
void fw_adc_init(struct fw_adc *fw);

/* Power on: the floor is dark. */
void fw_ground_init(struct fw_ground *fw);

/* Power on, or a reset. */
void fw_rab_init(struct fw_rab *fw);

/* The board hears a message. */
void fw_rab_hear(struct fw_rab *fw, const struct epuck_rab_message *message);

#ifdef __cplusplus
}
#endif

#endif
