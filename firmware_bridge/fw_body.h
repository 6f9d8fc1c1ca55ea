/* SPDX-License-Identifier: MIT */
/*
 * fw_body.h - the robot that every emulated microcontroller sits in: what its sensors
 * measure, what its motors and LEDs do, how far its wheels have turned, and the
 * watchdog that stock firmware lacks. Freestanding; time is an argument.
 */
#ifndef FW_BODY_H
#define FW_BODY_H

#include <stdint.h>

#include "fw_watchdog.h"

#ifdef __cplusplus
extern "C" {
#endif

#define FW_NEVER_US UINT64_MAX

/* What the sensors measure now, raw. */
struct fw_inputs {
    int16_t prox[8];     /* ps0..ps7, higher is nearer, below 0 with flickering light */
    int16_t light[8];    /* the same places, 0..4095, higher is darker */
    int16_t ground[3];   /* left, centre, right, 0..1023, higher is brighter */
    uint16_t battery_mv; /* [mV] */
    int16_t acceleration[3]; /* x, y, z; zeros where the firmware does not read them */
    int16_t microphones[4];  /* likewise; IRIDIA's firmware has three */
    int16_t rates[3];        /* x, y, z; an e-puck2's: 250 degrees a second are 32768 */
    uint16_t distance_mm;    /* [mm] ahead; an e-puck2's */
};

/* What the motors and LEDs do now. */
struct fw_outputs {
    int16_t left_steps_s;  /* [step/s] as clamped by the motor library */
    int16_t right_steps_s; /* [step/s] */
    uint16_t leds;         /* lit ones: bits 0-7 ring, 8 body, 9 front */
    uint8_t rgb[4][3];     /* [%] red, green, blue of an e-puck2's LED2, 4, 6, 8 */
};

struct fw_body {
    /* the owner writes */
    struct fw_inputs inputs;
    uint32_t watchdog_us; /* [us] without a command after which the motors stop, in whole
                             ticks of fw_watchdog.h; 0 = never, as stock firmware has it */
    /* the owner reads */
    struct fw_outputs outputs;
    uint64_t applied_us;  /* when a command, the watchdog or a reset changed them last */
    uint8_t changed;      /* they may have, since fw_body_take_change said so */
    uint32_t stops;       /* of the watchdog */
    /* its own */
    int16_t max_steps_s;
    uint16_t timer_hz;
    uint16_t timer_more;
    uint64_t rolled_us;   /* the steps are counted up to here */
    int64_t steps_e12[2]; /* [1e-12 step] of the left and the right wheel, modulo 65536 */
    struct fw_watchdog watchdog;
    uint64_t ticked_us;   /* its newest tick; the first one comes a whole tick after a command */
};

/* Power on: battery full, no light missing, motors and LEDs off. The time between two steps
 * is timer_hz / speed ticks, cut to a whole number, and timer_more ticks. */
void fw_body_init(struct fw_body *body, int16_t max_steps_s, uint16_t timer_hz,
                  uint16_t timer_more);

/* Reset: motors and LEDs off, counters at 0. The robot stays what it is. */
void fw_body_reset(struct fw_body *body, uint64_t now_us);

/* The motor library takes new speeds, clamped to what it can do. */
void fw_body_drive(struct fw_body *body, int32_t left_steps_s, int32_t right_steps_s,
                   uint64_t now_us);

/* The counter of a wheel, 0 left, 1 right: its low 16 bits. */
uint16_t fw_body_steps(struct fw_body *body, int wheel, uint64_t now_us);

/* Sets both counters. */
void fw_body_set_steps(struct fw_body *body, int16_t left, int16_t right, uint64_t now_us);

/* The outputs may have changed at now_us. */
void fw_body_apply(struct fw_body *body, uint64_t now_us);

/* Returns 1 if they may have since the last call, else 0. */
int fw_body_take_change(struct fw_body *body);

/* A command came: the watchdog waits for the next one. */
void fw_body_feed(struct fw_body *body, uint64_t now_us);

/* When the watchdog will stop the motors, FW_NEVER_US if not. */
uint64_t fw_body_watchdog_due_us(const struct fw_body *body);

/* Stops the motors if it is time. Returns 1 if it did: outputs have changed. */
int fw_body_watch(struct fw_body *body, uint64_t now_us);

#ifdef __cplusplus
}
#endif

#endif
