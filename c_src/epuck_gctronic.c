/* SPDX-License-Identifier: MIT */
#include "epuck_gctronic.h"

#include "epuck_bytes.h"

enum {
    RED_LEDS_AT = 5,
    RGB_LEDS_AT = 6,
    LIGHT_AT = 16,
    MICROPHONES_AT = 32,
    SELECTOR_AT = 40,
    STEPS_AT = 41,
    SELECTOR = 10 /* the only one at which this firmware speaks */
};

void epuck_gctronic_put_actuators(const struct epuck_gctronic_actuators *actuators,
                                  uint8_t packet[EPUCK_GCTRONIC_ACTUATOR_LEN])
{
    int i;

    epuck_zero(packet, EPUCK_GCTRONIC_ACTUATOR_LEN);
    epuck_put_u16(packet, (uint16_t)actuators->left_steps_s);
    epuck_put_u16(packet + 2, (uint16_t)actuators->right_steps_s);
    for (i = 0; i < EPUCK_GCTRONIC_RGB_LEDS; i++) {
        const uint8_t *rgb = actuators->rgb[i];
        uint8_t *at = packet + RGB_LEDS_AT + 3 * i;

        packet[RED_LEDS_AT] |= (uint8_t)((actuators->leds >> (2 * i) & 1) << i);
        at[0] = rgb[0];
        at[1] = rgb[1];
        at[2] = rgb[2];
        if (epuck_or(rgb, 3) == 0 && (actuators->leds >> (2 * i + 1) & 1))
            at[0] = EPUCK_GCTRONIC_BRIGHTNESS_MAX;
    }
    packet[EPUCK_GCTRONIC_ACTUATOR_LEN - 1] = epuck_xor(packet, EPUCK_GCTRONIC_ACTUATOR_LEN - 1);
}

int epuck_gctronic_get_actuators(const uint8_t packet[EPUCK_GCTRONIC_ACTUATOR_LEN],
                                 struct epuck_gctronic_actuators *actuators)
{
    int i;

    if (epuck_xor(packet, EPUCK_GCTRONIC_ACTUATOR_LEN) != 0)
        return -1;
    actuators->left_steps_s = epuck_get_s16(packet);
    actuators->right_steps_s = epuck_get_s16(packet + 2);
    actuators->leds = 0;
    for (i = 0; i < EPUCK_GCTRONIC_RGB_LEDS; i++) {
        const uint8_t *rgb = packet + RGB_LEDS_AT + 3 * i;

        actuators->rgb[i][0] = rgb[0];
        actuators->rgb[i][1] = rgb[1];
        actuators->rgb[i][2] = rgb[2];
        if (packet[RED_LEDS_AT] >> i & 1)
            actuators->leds |= (uint8_t)(1 << (2 * i));
        if (epuck_or(rgb, 3) != 0)
            actuators->leds |= (uint8_t)(1 << (2 * i + 1));
    }
    return 0;
}

void epuck_gctronic_put_sensors(const struct epuck_gctronic_sensors *sensors,
                                uint8_t packet[EPUCK_GCTRONIC_SENSOR_LEN])
{
    int i;

    epuck_zero(packet, EPUCK_GCTRONIC_SENSOR_LEN);
    for (i = 0; i < 8; i++) {
        epuck_put_u16(packet + 2 * i, (uint16_t)sensors->prox[i]);
        epuck_put_u16(packet + LIGHT_AT + 2 * i, (uint16_t)sensors->light[i]);
    }
    for (i = 0; i < 4; i++)
        epuck_put_u16(packet + MICROPHONES_AT + 2 * i, (uint16_t)sensors->microphones[i]);
    packet[SELECTOR_AT] = SELECTOR;
    epuck_put_u16(packet + STEPS_AT, sensors->steps[0]);
    epuck_put_u16(packet + STEPS_AT + 2, sensors->steps[1]);
    packet[EPUCK_GCTRONIC_SENSOR_LEN - 1] = epuck_xor(packet, EPUCK_GCTRONIC_SENSOR_LEN - 1);
}

int epuck_gctronic_get_sensors(const uint8_t packet[EPUCK_GCTRONIC_SENSOR_LEN],
                               struct epuck_gctronic_sensors *sensors)
{
    struct epuck_gctronic_sensors read;
    int i;

    if (epuck_or(packet, EPUCK_GCTRONIC_SENSOR_LEN) == 0 ||
        epuck_xor(packet, EPUCK_GCTRONIC_SENSOR_LEN) != 0)
        return -1;
    if (epuck_get_calibrated(packet, 8, read.prox) != 0 ||
        epuck_get_raw(packet + LIGHT_AT, 8, 0, EPUCK_GCTRONIC_RAW_MAX, read.light) != 0)
        return -1;
    for (i = 0; i < 4; i++) {
        uint16_t volume = epuck_get_u16(packet + MICROPHONES_AT + 2 * i);

        read.microphones[i] = (int16_t)(volume < INT16_MAX ? volume : INT16_MAX);
    }
    read.steps[0] = epuck_get_u16(packet + STEPS_AT);
    read.steps[1] = epuck_get_u16(packet + STEPS_AT + 2);
    *sensors = read;
    return 0;
}
