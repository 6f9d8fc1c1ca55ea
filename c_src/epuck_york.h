/* SPDX-License-Identifier: MIT */
/*
 * epuck_york.h - York's register map of an e-puck on a Pi-puck: I2C address 0x1F,
 * 100 kHz. Both ends use it.
 *
 * 16-bit registers, little-endian. A write is register, low, high; a read is register,
 * repeated START, low, high. Rules that keep the far end alive:
 * - exactly two bytes are read: a third one would hold the bus low until it is reset;
 * - at most three bytes are written;
 * - the low byte takes effect, with a high byte of 0, before the high byte has come: for
 *   about a millisecond a speed of -100 may be +156, so speeds are written on change;
 * - a counter may be read torn where its low byte carries.
 * There is no checksum. Until IR sensing is switched on proximity stays 0 and light 4095,
 * and a reset switches it off again.
 * An e-puck2 with branch pi-puck_proto-epuck1 has the same map in another program: it takes
 * writes as a whole, but not the one after an error on the bus, though that reads back; it
 * answers one byte of registers 0 and 1 and repeats it, always senses, and its light is
 * higher where it is darker.
 * Source: yorkrobotlab/pi-puck-e-puck1 i2c_slave.c, main.c, ir_sensors.c, commit 0041716;
 * e-puck2_main-processor src/gumstix.c, commit fcb74b1. Read, not tried on hardware.
 */
#ifndef EPUCK_YORK_H
#define EPUCK_YORK_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    EPUCK_YORK_ADDRESS = 0x1F,
    EPUCK_YORK_RING_LEDS = 0,   /* bit n = LED n */
    EPUCK_YORK_OTHER_LEDS = 1,  /* bit 0 front, bit 1 body */
    EPUCK_YORK_LEFT_SPEED = 2,  /* i16 [step/s] rewritten with the clamped value */
    EPUCK_YORK_RIGHT_SPEED = 3,
    EPUCK_YORK_LEFT_STEPS = 4,  /* u16 counter, it wraps */
    EPUCK_YORK_RIGHT_STEPS = 5,
    EPUCK_YORK_SENSING = 6,     /* bit 0 = IR sensing is on, 0 after a reset */
    EPUCK_YORK_PROX = 7,        /* 8 registers i16, ps0..ps7, not calibrated, higher is nearer */
    EPUCK_YORK_LIGHT = 15,      /* 8 registers, higher is brighter */
    EPUCK_YORK_REGISTERS = 23,
    EPUCK_YORK_WRITE_LEN = 3,   /* [byte] */
    EPUCK_YORK_READ_LEN = 2,    /* [byte] */
    EPUCK_YORK_RAW_MAX = 4095,  /* proximity lies within +- this, light within 0..this */
    EPUCK_YORK_SPEED_MAX = 1000 /* [step/s] clamped to +- this */
};

/* Writes the three bytes that set a register. */
void epuck_york_put_write(uint8_t number, uint16_t value, uint8_t out[EPUCK_YORK_WRITE_LEN]);

/* What registers 0 and 1 say together: bits 0-7 ring, 8 body, 9 front. */
uint16_t epuck_york_get_leds(uint16_t ring, uint16_t other);

/* Register 1 of LEDs 8 body and 9 front. */
uint16_t epuck_york_other_leds(uint16_t leds);

#ifdef __cplusplus
}
#endif

#endif
