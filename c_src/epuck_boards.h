/* SPDX-License-Identifier: MIT */
/*
 * epuck_boards.h - the boards that sit on an e-puck's I2C bus beside its
 * microcontroller: ground sensors (0x60), range and bearing (0x20), IRIDIA's three RGB LEDs
 * (0x61), and a Pi-puck's converter (0x48), which measures the battery. Both ends use it.
 *
 * Ground sensors: 16-bit registers, big-endian, read from register 0 with
 * auto-increment: left, centre, right, higher is brighter.
 * Range and bearing: 8-bit registers, read one byte at a time (a second byte would be
 * that of the first register again); reading register 0 takes a message out of a queue
 * of 10 and says whether there was one. The bearing is signed: other clients read it
 * unsigned and are wrong by 15 degrees for everything on the right.
 * Converter: an ADS1015 of 12 bits, 16-bit registers, big-endian. Channel 0 has half of the
 * battery's voltage, and with its range of +-4.096 V one unit is 2 mV.
 * RGB LEDs: 9 bytes and no register before them, red, green, blue of LED 2, then of 1 and 0.
 * Source: argos3-epuck real_epuck_ground_sensor.cpp, real_epuck_rgb_leds_actuator.cpp:16-50 and
 * real_epuck_range_and_bearing_{sensor,actuator}.cpp, commit 66cb8d9;
 * gctronic/range_and_bearing_firmware I2CSlaveDrv.c, IRReception.c, commit f928563;
 * erab_firmware/e-RandB_firmware_parametric/I2CSlaveDrv.c of argos3-epuck;
 * gctronic/Pi-puck battery/old/read-battery.py:6-16, commit 73b8913; the ADS1015's data sheet.
 * Read, not tried on hardware.
 */
#ifndef EPUCK_BOARDS_H
#define EPUCK_BOARDS_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    EPUCK_GROUND_ADDRESS = 0x60,
    EPUCK_GROUND_LEN = 6,       /* [byte] from register 0 */
    EPUCK_GROUND_MAX = 1023,    /* raw */

    EPUCK_RAB_ADDRESS = 0x20,
    EPUCK_RAB_QUEUE = 10,       /* messages that wait for their reader */
    EPUCK_RAB_SENSORS = 12,
    EPUCK_RAB_GAP_NS = 20000000, /* [ns] between two polls, sends or settings */

    /* read */
    EPUCK_RAB_TAKE = 0,         /* 1: a message was taken out of the queue */
    EPUCK_RAB_DATA_1 = 1,       /* data[1]; the number's bits 15..8 */
    EPUCK_RAB_DATA_0 = 2,       /* data[0] */
    EPUCK_RAB_BEARING_HIGH = 3, /* i16 [1e-4 rad] counter-clockwise from straight ahead */
    EPUCK_RAB_BEARING_LOW = 4,
    EPUCK_RAB_RANGE_HIGH = 5,   /* u16, raw: cm = k exp(9.0642 - 0.0056507 raw) */
    EPUCK_RAB_RANGE_LOW = 6,
    EPUCK_RAB_DATA_3 = 10,      /* data[3], IRIDIA's firmware only */
    EPUCK_RAB_DATA_2 = 11,      /* data[2] */

    /* write */
    EPUCK_RAB_POWER = 12,       /* 0 = about 1 m .. 255 = nearly nothing */
    EPUCK_RAB_POWER_DEFAULT = 115, /* what ARGoS writes */
    EPUCK_RAB_FIRST = 13,       /* number = this byte */
    EPUCK_RAB_SEND = 14,        /* number = number << 8 | this byte; sends it on all emitters */
    EPUCK_RAB_STORE_LIGHT = 16, /* any byte: the light around now counts as none */
    EPUCK_RAB_ON_ROBOT = 17,    /* 0 = the board computes range and bearing itself */
    EPUCK_RAB_THEN = 19,        /* number = number << 8 | this byte, IRIDIA's firmware only */
    EPUCK_RAB_THEN_TOO = 20,    /* the same */
    EPUCK_RAB_BITS = 21,        /* length of a message: 8, 16 (default), 24, 32; IRIDIA's only */

    EPUCK_RGB_ADDRESS = 0x61,
    EPUCK_RGB_LEDS = 3,         /* 0 front left, 1 front right, 2 back */
    EPUCK_RGB_LEN = 9,

    EPUCK_ADC_ADDRESS = 0x48,
    EPUCK_ADC_VALUE = 0,        /* register: the newest conversion, in the upper 12 bits */
    EPUCK_ADC_SETTINGS = 1,     /* register; bit 15 begins one, and is 1 when none is under way */
    EPUCK_ADC_BATTERY = 0xC383, /* convert once: channel 0, +-4.096 V, 1600 a second */
    EPUCK_ADC_TIME_NS = 1000000 /* [ns] that takes, and some more */
};

/* A message as the range-and-bearing board heard it. */
struct epuck_rab_message {
    uint8_t data[4];       /* as ARGoS numbers them; [0], [1] only with the stock firmware */
    int16_t bearing_e4rad; /* [1e-4 rad] of the sender, counter-clockwise, -pi..pi */
    uint16_t range_raw;    /* higher is nearer */
};

/* Reads the ground sensors' registers. Returns 0, or -1 if they are out of range. */
int epuck_ground_get(const uint8_t registers[EPUCK_GROUND_LEN], int16_t ground[3]);

/* Writes what the ground sensors' registers hold. */
void epuck_ground_put(const int16_t ground[3], uint8_t registers[EPUCK_GROUND_LEN]);

/* Writes what makes the RGB LEDs shine: red, green, blue of each, 0..255. */
void epuck_rgb_put(const uint8_t rgb[EPUCK_RGB_LEDS][3], uint8_t out[EPUCK_RGB_LEN]);

/* The other way round. */
void epuck_rgb_get(const uint8_t out[EPUCK_RGB_LEN], uint8_t rgb[EPUCK_RGB_LEDS][3]);

/* [mV] of the battery, of what EPUCK_ADC_VALUE holds. */
uint16_t epuck_adc_get_battery(const uint8_t value[2]);

/* The other way round, to the nearest 4 mV. */
void epuck_adc_put_battery(uint16_t mv, uint8_t value[2]);

/* The registers that hold a message of 2 or 4 bytes once it was taken, *count of them. */
const uint8_t *epuck_rab_reads(uint8_t size, size_t *count);

/* Makes a message of what those registers hold. Returns 0, or -1 if the bearing is
 * beyond pi. */
int epuck_rab_get(const uint8_t *registers, uint8_t size, struct epuck_rab_message *message);

/* The other way round. */
void epuck_rab_put(const struct epuck_rab_message *message, uint8_t size, uint8_t *registers);

/* The registers that data[size - 1], .., data[0] are written to, in that order: the last
 * one sends. */
const uint8_t *epuck_rab_writes(uint8_t size);

#ifdef __cplusplus
}
#endif

#endif
