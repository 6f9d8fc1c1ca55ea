/* SPDX-License-Identifier: MIT */
#include "epuck_argos.h"

#include "epuck_bytes.h"

enum {
    PROX_AT = 8,
    BATTERY_AT = 24,
    ACCELERATION_AT = 26,
    MICROPHONES_AT = 32,
    MICROPHONES_PAD_AT = 38,
    LIGHT_AT = 40,
    RAB_RECEIVED_AT = 56,
    PAD_AT = 61,
    RING_LEDS_AT = 6,
    OTHER_LEDS_AT = 7,
    IRCOM_ENABLE_AT = 8,
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
    frame[EPUCK_ARGOS_RESET_AT] = actuators->reset;
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
    actuators->reset = frame[EPUCK_ARGOS_RESET_AT];
}

void epuck_argos_put_sensors(const struct epuck_argos_sensors *sensors,
                             uint8_t frame[EPUCK_ARGOS_SENSOR_LEN])
{
    epuck_zero(frame, EPUCK_ARGOS_SENSOR_LEN);
    for (size_t i = 0; i < 8; i++) {
        epuck_put_u16(frame + PROX_AT + 2 * i, (uint16_t)sensors->prox[i]);
        epuck_put_u16(frame + LIGHT_AT + 2 * i, (uint16_t)sensors->light[i]);
    }
    for (size_t i = 0; i < 3; i++) {
        epuck_put_u16(frame + ACCELERATION_AT + 2 * i, (uint16_t)sensors->acceleration[i]);
        epuck_put_u16(frame + MICROPHONES_AT + 2 * i, (uint16_t)sensors->microphones[i]);
    }
    epuck_put_u16(frame + BATTERY_AT, sensors->battery_good);
    epuck_put_u16(frame + RAB_RECEIVED_AT, sensors->rab_received);
}

int epuck_argos_get_sensors(const uint8_t frame[EPUCK_ARGOS_SENSOR_LEN],
                            struct epuck_argos_sensors *sensors)
{
    int bad = (frame[PAD_AT] | frame[MICROPHONES_PAD_AT] | frame[MICROPHONES_PAD_AT + 1]) != 0;

    sensors->battery_good = epuck_get_u16(frame + BATTERY_AT);
    sensors->rab_received = epuck_get_u16(frame + RAB_RECEIVED_AT);
    bad |= sensors->battery_good > 1;
    bad |= -epuck_get_raw(frame + PROX_AT, 8, -EPUCK_ARGOS_RAW_MAX, EPUCK_ARGOS_RAW_MAX,
                         sensors->prox);
    bad |= -epuck_get_raw(frame + LIGHT_AT, 8, 0, EPUCK_ARGOS_RAW_MAX, sensors->light);
    bad |= -epuck_get_raw(frame + ACCELERATION_AT, 3, -EPUCK_ARGOS_RAW_MAX, EPUCK_ARGOS_RAW_MAX,
                         sensors->acceleration);
    bad |= -epuck_get_raw(frame + MICROPHONES_AT, 3, 0, EPUCK_ARGOS_RAW_MAX, sensors->microphones);
    return -bad;
}
