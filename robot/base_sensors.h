/* SPDX-License-Identifier: MIT */
/* base_sensors.h - what a base and its boards measure, as controllers know it: sensors with a
 * name and numbers, laid out as the virtual sensors of the same names. Pure. */
#ifndef VS_BASE_SENSORS_H
#define VS_BASE_SENSORS_H

#include "base.h"

enum {
    VS_BASE_PROXIMITY = 0, /* 8 numbers, raw */
    VS_BASE_LIGHT,         /* 8 numbers, raw */
    VS_BASE_BATTERY,       /* "battery_low": 0 or 1 */
    VS_BASE_GROUND,        /* 3 numbers, 0 black .. 1 white: left, centre, right */
    VS_BASE_WHEELS,        /* [cm] way of the left and the right wheel since the start */
    VS_BASE_RAB,           /* "range_and_bearing": how many messages, then for each of 5 places
                              [cm] range, [rad] bearing, 4 bytes; the newest first */
    VS_BASE_ACCELEROMETER, /* 3 numbers, raw: x, y, z */
    VS_BASE_MICROPHONES,   /* 3 or 4 numbers, raw */
    VS_BASE_VOLTAGE,       /* "battery": [mV] */
    VS_BASE_GYROSCOPE,     /* 3 numbers [rad/s]: x, y, z */
    VS_BASE_DISTANCE,      /* [mm] ahead */
    VS_BASE_SENSORS
};

#define VS_BASE_HEARD_MAX 5
#define VS_BASE_NUMBERS_MAX (1 + 6 * VS_BASE_HEARD_MAX) /* of any of these sensors */

/* The sensor of that name, -1 if there is none. */
int vs_base_sensor(const char *name);

/* 1 if the base that gave this reading has the sensor. */
int vs_base_has(const struct vs_base_reading *reading, int sensor);

/* [mV] of the battery, 0 if neither base nor board knows it; and whether it is low: 0, 1 or
 * VS_UNKNOWN. */
uint16_t vs_base_battery_mv(const struct vs_base_reading *reading);
uint8_t vs_base_battery_low(const struct vs_base_reading *reading);

/* The sensor's numbers, at most max. heard_from: messages before the heard_from-th are old.
 * Returns how many it has, 0 if they are not known. */
int vs_base_values(const struct vs_base_reading *reading, int sensor, uint32_t heard_from,
                   double *values, int max);

#endif
