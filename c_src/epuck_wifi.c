/* SPDX-License-Identifier: MIT */
#include "epuck_wifi.h"

#include "epuck_bytes.h"

enum { /* places in what comes after EPUCK_WIFI_SENSORS */
    ACCELERATION_AT = 0,
    RATES_AT = 18,
    PROX_AT = 37,
    LIGHT_AT = 53,
    DISTANCE_AT = 69,
    MICROPHONES_AT = 71,
    STEPS_AT = 79,
    BATTERY_AT = 83,
    GROUND_AT = 90,
    GROUND_MAX = 1023,
    SPEEDS_AT = 3, /* in a command */
    LEDS_AT = 7,
    RGB_AT = 8,
    RED_LEDS = 4 /* of the ring, each beside a coloured one */
};

void epuck_wifi_put_command(const struct epuck_wifi_command *command,
                            uint8_t packet[EPUCK_WIFI_COMMAND_LEN])
{
    int i;

    epuck_zero(packet, EPUCK_WIFI_COMMAND_LEN);
    packet[0] = EPUCK_WIFI_COMMAND;
    packet[1] = command->asks;
    epuck_put_u16(packet + SPEEDS_AT, (uint16_t)command->left_steps_s);
    epuck_put_u16(packet + SPEEDS_AT + 2, (uint16_t)command->right_steps_s);
    for (i = 0; i < RED_LEDS; i++)
        packet[LEDS_AT] |= (uint8_t)((command->leds >> (2 * i) & 1) << i);
    packet[LEDS_AT] |= (uint8_t)((command->leds >> 8 & 3) << RED_LEDS);
    for (i = 0; i < 12; i++)
        packet[RGB_AT + i] = command->rgb[i / 3][i % 3];
}

int epuck_wifi_get_command(const uint8_t packet[EPUCK_WIFI_COMMAND_LEN],
                           struct epuck_wifi_command *command)
{
    int i;

    if (packet[0] != EPUCK_WIFI_COMMAND)
        return -1;
    command->asks = packet[1];
    command->left_steps_s = epuck_get_s16(packet + SPEEDS_AT);
    command->right_steps_s = epuck_get_s16(packet + SPEEDS_AT + 2);
    command->leds = (uint16_t)((packet[LEDS_AT] >> RED_LEDS & 3) << 8);
    for (i = 0; i < RED_LEDS; i++)
        command->leds |= (uint16_t)((packet[LEDS_AT] >> i & 1) << (2 * i));
    for (i = 0; i < 12; i++)
        command->rgb[i / 3][i % 3] = packet[RGB_AT + i];
    return 0;
}

int epuck_wifi_get_sensors(const uint8_t packet[EPUCK_WIFI_SENSORS_LEN],
                           struct epuck_wifi_sensors *sensors)
{
    int i;

    if (epuck_get_calibrated(packet + PROX_AT, 8, sensors->prox) != 0 ||
        epuck_get_raw(packet + LIGHT_AT, 8, 0, EPUCK_WIFI_RAW_MAX, sensors->light) != 0 ||
        epuck_get_raw(packet + GROUND_AT, 3, 0, GROUND_MAX, sensors->ground) != 0)
        return -1;
    for (i = 0; i < 3; i++) {
        sensors->acceleration[i] = epuck_get_s16(packet + ACCELERATION_AT + 2 * i);
        sensors->rates[i] = epuck_get_s16(packet + RATES_AT + 2 * i);
    }
    for (i = 0; i < 4; i++)
        sensors->microphones[i] = epuck_get_s16(packet + MICROPHONES_AT + 2 * i);
    sensors->distance_mm = epuck_get_u16(packet + DISTANCE_AT);
    sensors->steps[0] = epuck_get_u16(packet + STEPS_AT);
    sensors->steps[1] = epuck_get_u16(packet + STEPS_AT + 2);
    sensors->battery = epuck_get_u16(packet + BATTERY_AT);
    return 0;
}

static void put(uint8_t *at, const int16_t *values, int count)
{
    int i;

    for (i = 0; i < count; i++)
        epuck_put_u16(at + 2 * i, (uint16_t)values[i]);
}

void epuck_wifi_put_sensors(const struct epuck_wifi_sensors *sensors,
                            uint8_t packet[EPUCK_WIFI_SENSORS_LEN])
{
    epuck_zero(packet, EPUCK_WIFI_SENSORS_LEN);
    put(packet + ACCELERATION_AT, sensors->acceleration, 3);
    put(packet + RATES_AT, sensors->rates, 3);
    put(packet + PROX_AT, sensors->prox, 8);
    put(packet + LIGHT_AT, sensors->light, 8);
    put(packet + MICROPHONES_AT, sensors->microphones, 4);
    put(packet + GROUND_AT, sensors->ground, 3);
    epuck_put_u16(packet + DISTANCE_AT, sensors->distance_mm);
    epuck_put_u16(packet + STEPS_AT, sensors->steps[0]);
    epuck_put_u16(packet + STEPS_AT + 2, sensors->steps[1]);
    epuck_put_u16(packet + BATTERY_AT, sensors->battery);
}
