/* SPDX-License-Identifier: MIT */
/*
 * epuck_gctronic.h - the packet that an e-puck2 with GCtronic's gumstix firmware
 * exchanges over I2C, address 0x1F, 100 kHz, selector 10. Both ends use it.
 *
 * One transaction: write 20 bytes of actuators, repeated START, read 47 bytes of
 * sensors; the last byte of each is the XOR of those before it. Rules of the far end:
 * - the answer is composed when the write ends; the packet is applied later, and a bad
 *   checksum only means that it is not, which no answer tells;
 * - after an error on the bus the next good packet is dropped, too;
 * - a read before the first write gives 47 zeros, whose checksum is right, as does a
 *   bus that is stuck low.
 * Source: e-puck2/e-puck2_main-processor branch gumstix, src/gumstix.c, commit 517ef07;
 * gctronic/Pi-puck e-puck2/e-puck2_test.c, commit 73b8913. Read, not tried on hardware.
 */
#ifndef EPUCK_GCTRONIC_H
#define EPUCK_GCTRONIC_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    EPUCK_GCTRONIC_ADDRESS = 0x1F,
    EPUCK_GCTRONIC_ACTUATOR_LEN = 20,   /* [byte] host to e-puck */
    EPUCK_GCTRONIC_SENSOR_LEN = 47,     /* [byte] e-puck to host */
    EPUCK_GCTRONIC_SPEED_MAX = 1100,    /* [step/s] it clamps to +- this */
    EPUCK_GCTRONIC_RAW_MAX = 4095,      /* of proximity and light as they are given here */
    EPUCK_GCTRONIC_RGB_LEDS = 4,
    EPUCK_GCTRONIC_BRIGHTNESS_MAX = 100 /* [%] of one colour of an RGB LED. Source: src/leds.h:10 */
};

/* What the host commands: no sound, and none of the settings of byte 18. */
struct epuck_gctronic_actuators {
    int16_t left_steps_s;
    int16_t right_steps_s;
    uint8_t leds; /* lit ones of the ring: even bits LED1,3,5,7, odd bits the RGB LED2,4,6,8,
                     which are lit red if their rgb is black */
    uint8_t rgb[EPUCK_GCTRONIC_RGB_LEDS][3]; /* [%] red, green, blue of LED2,4,6,8 */
};

/* What the e-puck measured. */
struct epuck_gctronic_sensors {
    int16_t prox[8];   /* ps0..ps7, calibrated, higher is nearer */
    int16_t light[8];  /* ps0..ps7, higher is darker */
    int16_t microphones[4]; /* loudness, what is above 32767 as that */
    uint16_t steps[2]; /* left, right counters, low 16 bits */
};

/* Writes an actuator packet, checksum included. */
void epuck_gctronic_put_actuators(const struct epuck_gctronic_actuators *actuators,
                                  uint8_t packet[EPUCK_GCTRONIC_ACTUATOR_LEN]);

/* Reads an actuator packet. Returns 0, or -1: bad checksum, *actuators is left alone. */
int epuck_gctronic_get_actuators(const uint8_t packet[EPUCK_GCTRONIC_ACTUATOR_LEN],
                                 struct epuck_gctronic_actuators *actuators);

/* Writes a sensor packet, checksum included; fields without a source are 0. */
void epuck_gctronic_put_sensors(const struct epuck_gctronic_sensors *sensors,
                                uint8_t packet[EPUCK_GCTRONIC_SENSOR_LEN]);

/* Reads a sensor packet. Returns 0, or -1 with *sensors left alone: bad checksum, a
 * value out of range, or nothing but zeros. */
int epuck_gctronic_get_sensors(const uint8_t packet[EPUCK_GCTRONIC_SENSOR_LEN],
                               struct epuck_gctronic_sensors *sensors);

#ifdef __cplusplus
}
#endif

#endif
