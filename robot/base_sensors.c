/* SPDX-License-Identifier: MIT */
#include "base_sensors.h"

#include <string.h>

#include "../c_src/vs_body.h"

#define CM_PER_NM 1e-7
#define RAD_PER_E4 1e-4
/* Range of a message, k exp(9.0642 - 0.0056507 raw) cm, as a power.
 * Source: argos3-epuck 66cb8d9 real_epuck_range_and_bearing_sensor.cpp:62-67, 73-74. */
#define RANGE_PER_K 8640.552554617
#define RANGE_BASE 0.99436518665

enum { BATTERY_LOW_MV = 3400 }; /* what the e-puck's own pin says */
enum { RING = 8, PLACE = 6, AXES = 3 };

static const char *const names[VS_BASE_SENSORS] = {"proximity", "light",  "battery_low",
                                                   "ground",    "wheels", "range_and_bearing",
                                                   "accelerometer", "microphones", "battery",
                                                   "gyroscope", "distance"};

int vs_base_sensor(const char *name)
{
    int i;

    for (i = 0; i < VS_BASE_SENSORS; i++)
        if (strcmp(name, names[i]) == 0)
            return i;
    return -1;
}

/* A sensor that measures never reads 0 in all of its numbers: gravity, and the middle of the
 * converter's range, are in them. */
static int measures(const int16_t *raw, int count)
{
    int16_t any = 0;

    while (count > 0)
        any |= raw[--count];
    return any != 0;
}

uint16_t vs_base_battery_mv(const struct vs_base_reading *reading)
{
    return reading->battery_mv != 0 ? reading->battery_mv : reading->boards.battery_mv;
}

uint8_t vs_base_battery_low(const struct vs_base_reading *reading)
{
    if (reading->battery_low != VS_UNKNOWN || reading->boards.battery_mv == 0)
        return reading->battery_low;
    return reading->boards.battery_mv < BATTERY_LOW_MV;
}

int vs_base_has(const struct vs_base_reading *reading, int sensor)
{
    switch (sensor) {
    case VS_BASE_PROXIMITY:
    case VS_BASE_LIGHT:
        return !reading->blind;
    case VS_BASE_GROUND:
        return reading->has_ground || (reading->boards.there >> VS_BOARD_GROUND & 1);
    case VS_BASE_WHEELS:
        return reading->has_steps;
    case VS_BASE_RAB:
        return reading->boards.there >> VS_BOARD_RAB & 1;
    case VS_BASE_ACCELEROMETER:
        return measures(reading->acceleration, AXES);
    case VS_BASE_MICROPHONES:
        return measures(reading->microphones, reading->microphone_count);
    case VS_BASE_VOLTAGE:
        return reading->battery_mv != 0 || (reading->boards.there >> VS_BOARD_BATTERY & 1);
    case VS_BASE_GYROSCOPE:
        return reading->has_rates || (reading->boards.there >> VS_BOARD_IMU & 1);
    case VS_BASE_DISTANCE:
        return reading->has_distance;
    default:
        return sensor == VS_BASE_BATTERY;
    }
}

static int raw_values(const int16_t *raw, int count, double *values, int max)
{
    int i;

    for (i = 0; i < count && i < max; i++)
        values[i] = raw[i];
    return count;
}

/* Three numbers that the base measures itself, or else a board may: as parts of unit. */
static int three_values(const int16_t *own, const int16_t *board, double unit, double *values,
                        int max)
{
    const int16_t *raw = own != NULL ? own : board;
    int i;

    if (raw == NULL)
        return 0;
    for (i = 0; i < 3 && i < max; i++)
        values[i] = (double)raw[i] / unit;
    return 3;
}

static int one_value(uint16_t value, uint16_t unknown, double *values, int max)
{
    if (value == unknown)
        return 0;
    if (max > 0)
        values[0] = value;
    return 1;
}

static int wheel_values(const struct vs_base_reading *reading, double *values, int max)
{
    int i;

    for (i = 0; i < 2 && i < max; i++)
        values[i] = (double)reading->steps[i] * reading->step_nm * CM_PER_NM;
    return 2;
}

static double range_cm(uint16_t raw, float k_cm)
{
    double factor = RANGE_BASE;
    double cm = RANGE_PER_K * (double)k_cm;

    for (; raw > 0; raw >>= 1, factor *= factor)
        if (raw & 1)
            cm *= factor;
    return cm;
}

/* Number `at` of a message's place. */
static double place_value(const struct epuck_rab_message *message, float k_cm, int at)
{
    if (at == 0)
        return range_cm(message->range_raw, k_cm);
    return at == 1 ? message->bearing_e4rad * RAD_PER_E4 : message->data[at - 2];
}

static int rab_values(const struct vs_base_reading *reading, uint32_t heard_from, double *values,
                      int max)
{
    const struct vs_board_reading *boards = &reading->boards;
    uint32_t fresh = boards->heard_count - heard_from;
    int count = fresh < VS_BASE_HEARD_MAX ? (int)fresh : VS_BASE_HEARD_MAX;
    int i;

    if (!boards->has[VS_BOARD_RAB])
        return 0;
    for (i = 0; i < VS_BASE_NUMBERS_MAX && i < max; i++) {
        uint32_t number = boards->heard_count - 1 - (uint32_t)((i - 1) / PLACE);

        if (i == 0)
            values[i] = count;
        else if ((i - 1) / PLACE < count)
            values[i] = place_value(&boards->heard[number % VS_BOARD_HEARD], boards->rab_k_cm,
                                    (i - 1) % PLACE);
        else
            values[i] = 0.0;
    }
    return VS_BASE_NUMBERS_MAX;
}

int vs_base_values(const struct vs_base_reading *reading, int sensor, uint32_t heard_from,
                   double *values, int max)
{
    const struct vs_board_reading *boards = &reading->boards;

    if (!vs_base_has(reading, sensor))
        return 0;
    switch (sensor) {
    case VS_BASE_PROXIMITY:
        return raw_values(reading->prox, RING, values, max);
    case VS_BASE_LIGHT:
        return raw_values(reading->light, RING, values, max);
    case VS_BASE_GROUND:
        return three_values(reading->has_ground ? reading->ground : NULL,
                            boards->has[VS_BOARD_GROUND] ? boards->ground : NULL,
                            EPUCK_GROUND_MAX, values, max);
    case VS_BASE_WHEELS:
        return wheel_values(reading, values, max);
    case VS_BASE_RAB:
        return rab_values(reading, heard_from, values, max);
    case VS_BASE_ACCELEROMETER:
        return raw_values(reading->acceleration, AXES, values, max);
    case VS_BASE_MICROPHONES:
        return raw_values(reading->microphones, reading->microphone_count, values, max);
    case VS_BASE_VOLTAGE:
        return one_value(vs_base_battery_mv(reading), 0, values, max);
    case VS_BASE_GYROSCOPE:
        return three_values(reading->has_rates ? reading->rates : NULL,
                            boards->has[VS_BOARD_IMU] ? boards->rates : NULL,
                            EPUCK_IMU_DIGITS, values, max);
    case VS_BASE_DISTANCE:
        return one_value(reading->distance_mm, 0, values, max);
    default:
        return one_value(vs_base_battery_low(reading), VS_UNKNOWN, values, max);
    }
}
