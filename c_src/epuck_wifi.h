/* SPDX-License-Identifier: MIT */
/*
 * epuck_wifi.h - an e-puck2 over its own Wi-Fi, without a board: TCP, port 1000. Both ends use it:
 * the daemon's base and the stand-in in firmware_bridge/.
 *
 * The host sends commands of 21 bytes. While one asks for them the robot sends packets: a byte that
 * says which, then so many more. It does not say which command it follows. Numbers are
 * little-endian.
 * Source: two programs that agree: cyberbotics/webots 0bc4549 e-puck2_server.c, and the interface of
 * the University of Fribourg; offsets as in field.md section 3. Read, not tried on hardware. What a
 * robot does when its connection breaks is not known: it counts as driving on.
 */
#ifndef EPUCK_WIFI_H
#define EPUCK_WIFI_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    EPUCK_WIFI_PORT = 1000,
    EPUCK_WIFI_COMMAND = 0x80, /* its first byte */
    EPUCK_WIFI_COMMAND_LEN = 21,
    EPUCK_WIFI_STREAM_SENSORS = 2, /* what a command asks for */
    EPUCK_WIFI_PICTURE = 1,        /* a packet's first byte, which then has 38,400 more */
    EPUCK_WIFI_PICTURE_LEN = 38400,
    EPUCK_WIFI_SENSORS = 2,        /* 104 more */
    EPUCK_WIFI_SENSORS_LEN = 104,
    EPUCK_WIFI_NOTHING = 3,        /* none more */
    EPUCK_WIFI_RAW_MAX = 4095,
    EPUCK_WIFI_BRIGHTNESS_MAX = 100 /* [%] of a coloured LED */
};

struct epuck_wifi_command {
    uint8_t asks;         /* EPUCK_WIFI_STREAM_SENSORS, or 0 */
    int16_t left_steps_s; /* [step/s] */
    int16_t right_steps_s;
    uint16_t leds;        /* lit ones: 0, 2, 4, 6 of the ring, 8 body, 9 front */
    uint8_t rgb[4][3];    /* [%] of 1, 3, 5, 7 of the ring */
};

struct epuck_wifi_sensors {
    int16_t acceleration[3]; /* raw */
    int16_t rates[3];        /* raw, as an e-puck2's over asercom */
    int16_t prox[8];         /* ps0..ps7 */
    int16_t light[8];        /* higher is darker */
    uint16_t distance_mm;    /* 0: not measured yet */
    int16_t microphones[4];
    uint16_t steps[2];       /* left, right, they wrap */
    uint16_t battery;        /* raw, as epuck_asercom_battery_mv takes it */
    int16_t ground[3];       /* 0: it has no such sensors */
};

void epuck_wifi_put_command(const struct epuck_wifi_command *command,
                            uint8_t packet[EPUCK_WIFI_COMMAND_LEN]);

/* For the stand-in: the other way round. Returns 0, or -1 if it is no command. */
int epuck_wifi_get_command(const uint8_t packet[EPUCK_WIFI_COMMAND_LEN],
                           struct epuck_wifi_command *command);

/* Reads what comes after EPUCK_WIFI_SENSORS. Returns 0, or -1 if no e-puck measures that. */
int epuck_wifi_get_sensors(const uint8_t packet[EPUCK_WIFI_SENSORS_LEN],
                           struct epuck_wifi_sensors *sensors);

/* For the stand-in. */
void epuck_wifi_put_sensors(const struct epuck_wifi_sensors *sensors,
                            uint8_t packet[EPUCK_WIFI_SENSORS_LEN]);

#ifdef __cplusplus
}
#endif

#endif
