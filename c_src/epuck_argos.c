/* SPDX-License-Identifier: MIT */
#include "epuck_argos.h"

#include "epuck_bytes.h"

enum {
    PROX_AT = 8,
    BATTERY_AT = 24,
    UNUSED_AT = 26, /* accelerometer and microphones, commented out in the firmware */
    UNUSED_LEN = 14,
    LIGHT_AT = 40,
    PAD_AT = 61,
    RING_LEDS_AT = 6,
    OTHER_LEDS_AT = 7,
    IRCOM_ENABLE_AT = 8,
    RESET_AT = 10,
    OTHER_FRONT = 1,
    OTHER_BODY = 2
};

void epuck_argos_put_actuators(const struct epuck_argos_actuators *actuators,
                               uint8_t frame[EPUCK_ARGOS_ACTUATOR_LEN])
{
    epuck_zero(frame, EPUCK_ARGOS_ACTUATOR_LEN);
    epuck_put_u16(frame, (uint16_t)actuators->left_steps_s);
    epuck_put_u16(frame + 2, (uint16_t)actuators->right_steps_s);
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
    actuators->left_steps_s = epuck_get_s16(frame);
    actuators->right_steps_s = epuck_get_s16(frame + 2);
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
    epuck_zero(frame, EPUCK_ARGOS_SENSOR_LEN);
    for (size_t i = 0; i < 8; i++) {
        epuck_put_u16(frame + PROX_AT + 2 * i, (uint16_t)sensors->prox[i]);
        epuck_put_u16(frame + LIGHT_AT + 2 * i, (uint16_t)sensors->light[i]);
    }
    epuck_put_u16(frame + BATTERY_AT, sensors->battery_low);
}

int epuck_argos_get_sensors(const uint8_t frame[EPUCK_ARGOS_SENSOR_LEN],
                            struct epuck_argos_sensors *sensors)
{
    struct epuck_argos_sensors read;

    read.battery_low = epuck_get_u16(frame + BATTERY_AT);
    if (read.battery_low > 1 || frame[PAD_AT] != 0 || epuck_or(frame + UNUSED_AT, UNUSED_LEN) != 0)
        return -1;
    for (size_t i = 0; i < 8; i++) {
        read.prox[i] = epuck_get_s16(frame + PROX_AT + 2 * i);
        read.light[i] = epuck_get_s16(frame + LIGHT_AT + 2 * i);
        if (read.prox[i] < -EPUCK_ARGOS_PROX_MAX || read.prox[i] > EPUCK_ARGOS_PROX_MAX ||
            read.light[i] < 0 || read.light[i] > EPUCK_ARGOS_PROX_MAX)
            return -1;
    }
    *sensors = read;
    return 0;
}
