/* SPDX-License-Identifier: MIT */
#include "fw_asercom_answers.h"

#include "epuck_bytes.h"

enum {
    BATTERY_LOW_MV = 3400,
    CLIFFS = 2,
    EPUCK2_CLIFFS = 1,
    EPUCK2_FULL_MV = 5000, /* e-puck2_main-processor d2e0dbb src/sensors/battery_level.h:14-15 */
    EPUCK2_FULL_RAW = 4096,
    SPEED_LEN = 4,
    LED_LEN = 2,
    I2C_LEN = 3,
    PANEL_LEN = 35,
    CODE_A = 0xBF,
    CODE_ACCELERATION = 0x9F,
    CODE_TEMPERATURE = 0x8C,
    CODE_MICROPHONES = 0x8B,
    CODE_I2C = 0xA9,
    CODE_PANEL = 0x89
};

#define NS_PER_US 1000u

static void add(struct fw_asercom *fw, uint16_t value)
{
    if (fw->reply_len + 2 > FW_ASERCOM_REPLY_MAX)
        return;
    epuck_put_u16(fw->reply + fw->reply_len, value);
    fw->reply_len += 2;
}

static void add_pair(struct fw_asercom *fw, uint16_t left, uint16_t right)
{
    add(fw, left);
    add(fw, right);
}

static void add_zeros(struct fw_asercom *fw, int words)
{
    for (; words > 0; words--)
        add(fw, 0);
}

static void add_ring(struct fw_asercom *fw, const int16_t ring[8])
{
    int i;

    for (i = 0; i < 8; i++)
        add(fw, (uint16_t)ring[i]);
    add_zeros(fw, (fw->mode->ring - 16) / 2);
}

static void add_ground(struct fw_asercom *fw)
{
    int i;

    if (fw_asercom_is_extension(fw))
        return;
    for (i = 0; i < 3; i++)
        add(fw, (uint16_t)(fw->mode->ground > 0 ? fw->body.inputs.ground[i] : 0));
    if (fw->mode->epuck2 > 0)
        add_zeros(fw, EPUCK2_CLIFFS);
    else
        add_zeros(fw, fw->mode->ground > 0 ? CLIFFS : 0);
}

static void add_steps(struct fw_asercom *fw)
{
    uint64_t now_us = fw->uart.lived_ns / NS_PER_US;

    add_pair(fw, fw_body_steps(&fw->body, 0, now_us), fw_body_steps(&fw->body, 1, now_us));
}

static void add_rates(struct fw_asercom *fw)
{
    int i;

    for (i = 0; i < 3; i++)
        add(fw, (uint16_t)(fw->mode->epuck2 > 0 ? fw->body.inputs.rates[i] : 0));
}

/* Raw value of the battery. Source: 2560 are about 4.2 V, 2070 about 3.4 V. */
static uint16_t raw_battery(const struct fw_asercom *fw)
{
    if (fw->mode->epuck2 > 0)
        return (uint16_t)((uint32_t)fw->body.inputs.battery_mv * EPUCK2_FULL_RAW / EPUCK2_FULL_MV);
    return (uint16_t)(2070 + ((int32_t)fw->body.inputs.battery_mv - BATTERY_LOW_MV) * 490 / 800);
}

uint32_t fw_asercom_payload(const struct fw_asercom *fw, uint8_t code)
{
    switch (code) {
    case EPUCK_ASERCOM_SPEED:
    case FW_ASERCOM_SET_STEPS:
        return SPEED_LEN;
    case EPUCK_ASERCOM_LED:
        return LED_LEN;
    case CODE_I2C:
        return fw_asercom_is_extension(fw) ? 0 : I2C_LEN;
    case CODE_PANEL:
        return fw_asercom_is_extension(fw) ? 0 : PANEL_LEN;
    default:
        return 0;
    }
}

/* What the daemon does not ask for. Other codes are unknown, or have no answer. */
static void answer_with_zeros(struct fw_asercom *fw, uint8_t code)
{
    if (code == CODE_A)
        add_zeros(fw, 6);
    else if (code == CODE_ACCELERATION || code == CODE_MICROPHONES)
        add_zeros(fw, 3);
    else if (code == CODE_TEMPERATURE && fw->reply_len < FW_ASERCOM_REPLY_MAX)
        fw->reply[fw->reply_len++] = 0;
}

void fw_asercom_answer(struct fw_asercom *fw, uint8_t code)
{
    const struct fw_inputs *inputs = &fw->body.inputs;

    switch (code) {
    case EPUCK_ASERCOM_PROX:
        add_ring(fw, inputs->prox);
        break;
    case EPUCK_ASERCOM_LIGHT:
        add_ring(fw, inputs->light);
        break;
    case EPUCK_ASERCOM_GROUND:
        add_ground(fw);
        break;
    case EPUCK_ASERCOM_COMMANDED:
        add_pair(fw, (uint16_t)fw->commanded[0], (uint16_t)fw->commanded[1]);
        break;
    case EPUCK_ASERCOM_STEPS:
        add_steps(fw);
        break;
    case EPUCK_ASERCOM_BATTERY:
        add(fw, raw_battery(fw));
        break;
    case EPUCK_ASERCOM_GYRO:
        add_rates(fw);
        break;
    case EPUCK_ASERCOM_DISTANCE:
        if (fw->mode->epuck2 > 0)
            add(fw, inputs->distance_mm);
        break;
    default:
        answer_with_zeros(fw, code);
        break;
    }
}
