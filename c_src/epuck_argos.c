/* SPDX-License-Identifier: MIT */
#include "epuck_argos.h"

enum {
    PROX_AT = 8,
    BATTERY_AT = 24,
    LIGHT_AT = 40,
    PAD_AT = 61,
    RING_LEDS_AT = 6,
    OTHER_LEDS_AT = 7,
    IRCOM_ENABLE_AT = 8,
    RESET_AT = 10,
    OTHER_FRONT = 1,
    OTHER_BODY = 2
};

static void put_u16(uint8_t *at, uint16_t value)
{
    at[0] = (uint8_t)(value & 0xFFu);
    at[1] = (uint8_t)(value >> 8);
}

static uint16_t get_u16(const uint8_t *at)
{
    return (uint16_t)(at[0] | (uint16_t)(at[1] << 8));
}

static int16_t get_s16(const uint8_t *at)
{
    int32_t value = get_u16(at);

    return (int16_t)(value < 0x8000 ? value : value - 0x10000);
}

static void zero(uint8_t *at, size_t len)
{
    for (size_t i = 0; i < len; i++) {
        at[i] = 0;
    }
}

void epuck_argos_put_actuators(const struct epuck_argos_actuators *actuators,
                               uint8_t frame[EPUCK_ARGOS_ACTUATOR_LEN])
{
    zero(frame, EPUCK_ARGOS_ACTUATOR_LEN);
    put_u16(frame, (uint16_t)actuators->left_steps_s);
    put_u16(frame + 2, (uint16_t)actuators->right_steps_s);
    frame[RING_LEDS_AT] = (uint8_t)(actuators->leds & 0xFFu);
    if (actuators->leds & EPUCK_ARGOS_LED_FRONT)
        frame[OTHER_LEDS_AT] |= OTHER_FRONT;
    if (actuators->leds & EPUCK_ARGOS_LED_BODY)
        frame[OTHER_LEDS_AT] |= OTHER_BODY;
    frame[IRCOM_ENABLE_AT] = actuators->ircom_enable;
    frame[RESET_AT] = actuators->reset;
}

void epuck_argos_get_actuators(const uint8_t frame[EPUCK_ARGOS_ACTUATOR_LEN],
                               struct epuck_argos_actuators *actuators)
{
    actuators->left_steps_s = get_s16(frame);
    actuators->right_steps_s = get_s16(frame + 2);
    actuators->leds = frame[RING_LEDS_AT];
    if (frame[OTHER_LEDS_AT] & OTHER_FRONT)
        actuators->leds |= EPUCK_ARGOS_LED_FRONT;
    if (frame[OTHER_LEDS_AT] & OTHER_BODY)
        actuators->leds |= EPUCK_ARGOS_LED_BODY;
    actuators->ircom_enable = frame[IRCOM_ENABLE_AT];
    actuators->reset = frame[RESET_AT];
}

void epuck_argos_put_sensors(const struct epuck_argos_sensors *sensors,
                             uint8_t frame[EPUCK_ARGOS_SENSOR_LEN])
{
    zero(frame, EPUCK_ARGOS_SENSOR_LEN);
    for (size_t i = 0; i < 8; i++) {
        put_u16(frame + PROX_AT + 2 * i, (uint16_t)sensors->prox[i]);
        put_u16(frame + LIGHT_AT + 2 * i, (uint16_t)sensors->light[i]);
    }
    put_u16(frame + BATTERY_AT, sensors->battery_low);
}

static int in_range(int16_t value)
{
    return value >= -EPUCK_ARGOS_PROX_MAX && value <= EPUCK_ARGOS_PROX_MAX;
}

int epuck_argos_get_sensors(const uint8_t frame[EPUCK_ARGOS_SENSOR_LEN],
                            struct epuck_argos_sensors *sensors)
{
    struct epuck_argos_sensors read;

    read.battery_low = get_u16(frame + BATTERY_AT);
    if (read.battery_low > 1 || frame[PAD_AT] != 0)
        return -1;
    for (size_t i = 0; i < 8; i++) {
        read.prox[i] = get_s16(frame + PROX_AT + 2 * i);
        read.light[i] = get_s16(frame + LIGHT_AT + 2 * i);
        if (!in_range(read.prox[i]) || !in_range(read.light[i]))
            return -1;
    }
    *sensors = read;
    return 0;
}
