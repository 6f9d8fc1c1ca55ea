/* SPDX-License-Identifier: MIT */
/*
 * epuck_argos.h - frames of the fixed-struct UART protocol that IRIDIA's
 * e-puck firmware speaks (argos3-epuck). Both ends use it: the daemon's base
 * and the microcontroller's end in firmware_bridge/.
 *
 * The link is 115200 baud 8N1 without framing, checksum or time-out:
 *   host -> PIC  1 byte, any value: wakes the PIC up
 *   host -> PIC  4 bytes of configuration
 *   then for ever: PIC -> host 72 bytes of sensors, host -> PIC 12 bytes of
 *   actuators. The PIC sends the sensors right after it applied the actuators.
 * Source: argos3-epuck firmware/firmware/firmware/epuck_firmware.c and
 * real_epuck_base.h, commit 66cb8d9.
 */
#ifndef EPUCK_ARGOS_H
#define EPUCK_ARGOS_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    EPUCK_ARGOS_CONFIG_LEN = 4,    /* [bytes] configuration after the wake-up */
    EPUCK_ARGOS_ACTUATOR_LEN = 12, /* [bytes] host to PIC */
    EPUCK_ARGOS_SENSOR_LEN = 72,   /* [bytes] PIC to host */
    EPUCK_ARGOS_BAUD = 115200,
    EPUCK_ARGOS_BYTE_NS = 86806,   /* [ns] one byte on the line, 10 bits */
    EPUCK_ARGOS_RING_LEDS = 8,     /* ring LEDs, bits 0 to 7 of `leds` */
    EPUCK_ARGOS_LED_BODY = 256,    /* bit 8 of `leds` */
    EPUCK_ARGOS_LED_FRONT = 512,   /* bit 9 of `leds` */
    EPUCK_ARGOS_LED_ALL = 1023,    /* every bit of `leds` that means something */
    EPUCK_ARGOS_RAW_MAX = 4096,    /* raw proximity and acceleration lie within +- this,
                                      light and microphones within 0..this */
    EPUCK_ARGOS_RESET = 82,        /* 'R': PIC applies the frame, then waits for
                                      a wake-up byte again */
    EPUCK_ARGOS_RESET_AT = 10,     /* where in the frame */
    EPUCK_ARGOS_REST_RAW = 2048,   /* middle of the converter: no acceleration, silence */
    EPUCK_ARGOS_GRAVITY_RAW = 800  /* 1 g, about. Source of both: e-puck2_main-processor
                                      d2e0dbb src/epuck1x/a_d/advance_ad_scan/e_acc.c:20,39 */
};

/* What the host commands. Range-and-bearing is sent as 0. */
struct epuck_argos_actuators {
    int16_t left_steps_s;  /* [steps/s] the motor library clamps to +-1000 */
    int16_t right_steps_s; /* [steps/s] */
    uint16_t leds;         /* bits 0-7 ring, 8 body, 9 front */
    uint8_t ircom_enable;  /* not 0: send an infrared word first */
    uint8_t reset;         /* EPUCK_ARGOS_RESET or 0 */
};

/* What the PIC measured. Of range-and-bearing and IRcom nothing else is decoded. */
struct epuck_argos_sensors {
    int16_t prox[8];      /* [raw ADC] e-puck order ps0..ps7, higher is nearer */
    int16_t light[8];     /* [raw ADC] same places, 0..4096, higher is darker */
    uint16_t battery_good;   /* pin BATT_LOW, active low: 0 below about 3.4 V, else 1 */
    int16_t acceleration[3]; /* [raw ADC] x, y, z; zeros where the firmware has it commented
                                out, as the public one has */
    int16_t microphones[3];  /* [raw ADC] right, left, back; likewise */
    uint16_t rab_received;   /* not 0: its own range-and-bearing is on, and heard something */
};

/* Writes the 12 bytes of an actuator frame. */
void epuck_argos_put_actuators(const struct epuck_argos_actuators *actuators,
                               uint8_t frame[EPUCK_ARGOS_ACTUATOR_LEN]);

/* Reads the 12 bytes of an actuator frame. Every byte string is a frame. */
void epuck_argos_get_actuators(const uint8_t frame[EPUCK_ARGOS_ACTUATOR_LEN],
                               struct epuck_argos_actuators *actuators);

/* Writes the 72 bytes of a sensor frame; fields without a source are 0. */
void epuck_argos_put_sensors(const struct epuck_argos_sensors *sensors,
                             uint8_t frame[EPUCK_ARGOS_SENSOR_LEN]);

/* Reads the 72 bytes of a sensor frame.
 * Returns 0, or -1 if no PIC would send them: a lost byte shifts every later
 * one, and only implausible values show it (flag not 0 or 1, a pad not 0, a sensor
 * beyond what the converter gives). *sensors then means nothing. Range-and-bearing may
 * be anything: an earlier host may have enabled it. */
int epuck_argos_get_sensors(const uint8_t frame[EPUCK_ARGOS_SENSOR_LEN],
                            struct epuck_argos_sensors *sensors);

#ifdef __cplusplus
}
#endif

#endif
