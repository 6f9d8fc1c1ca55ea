/* SPDX-License-Identifier: MIT */
#include "epuck_asercom.h"

#include "epuck_bytes.h"

enum {
    RING_LEDS = 0xFF,
    ALL_LEDS = 0x3FF,
    BATTERY_FLAG_MAX = 1, /* older hardware answers 0 or 1 */
    BATTERY_LOW_MV = 3400,
    BATTERY_LOW_RAW = 2070,
    BATTERY_SPAN_MV = 800,
    BATTERY_SPAN_RAW = 490,
    EPUCK2_FULL_MV = 5000, /* its converter's most */
    EPUCK2_FULL_RAW = 4096,
    BATTERY_LEN = 2,
    RATES_LEN = 6,
    DISTANCE_LEN = 2,
    EPUCK2_ONLY = 2, /* questions for an e-puck2 */
    PAIR_LEN = 4 /* two 16-bit numbers: counters, speeds */
};

const struct epuck_asercom_mode epuck_asercom_modes[EPUCK_ASERCOM_MODES] = {
    {230400, 20, 0, 0, RING_LEDS}, /* takes 'L' of body and front, and does nothing */
    {115200, 16, 0, 0, ALL_LEDS},
    {115200, 16, 10, 0, ALL_LEDS},
    {115200, 16, 0, RATES_LEN + DISTANCE_LEN, ALL_LEDS},
    {115200, 16, 8, RATES_LEN + DISTANCE_LEN, ALL_LEDS},
};

const uint8_t epuck_asercom_resync[EPUCK_ASERCOM_RESYNC_LEN] = {
    [36] = '\r',
    [37] = 'V',
    [38] = '\r',
};

size_t epuck_asercom_put_poll(const struct epuck_asercom_mode *mode,
                              const struct epuck_asercom_poll *poll,
                              uint8_t packet[EPUCK_ASERCOM_REQUEST_MAX])
{
    static const uint8_t asked[] = {EPUCK_ASERCOM_PROX,    EPUCK_ASERCOM_LIGHT,
                                    EPUCK_ASERCOM_STEPS,   EPUCK_ASERCOM_BATTERY,
                                    EPUCK_ASERCOM_GYRO,    EPUCK_ASERCOM_DISTANCE};
    size_t count = sizeof asked - (mode->epuck2 > 0 ? 0 : EPUCK2_ONLY);
    uint8_t *at = packet;
    uint8_t led;
    size_t i;

    *at++ = EPUCK_ASERCOM_SPEED;
    epuck_put_u16(at, (uint16_t)poll->left_steps_s);
    epuck_put_u16(at + 2, (uint16_t)poll->right_steps_s);
    at += PAIR_LEN;
    for (led = 0; led < EPUCK_ASERCOM_LEDS; led++) {
        if (((poll->change & mode->leds) >> led & 1) == 0)
            continue;
        *at++ = EPUCK_ASERCOM_LED;
        *at++ = led;
        *at++ = (uint8_t)(poll->leds >> led & 1);
    }
    for (i = 0; i < count; i++)
        *at++ = asked[i];
    if (mode->ground > 0)
        *at++ = EPUCK_ASERCOM_GROUND;
    *at++ = EPUCK_ASERCOM_COMMANDED;
    *at++ = 0;
    return (size_t)(at - packet);
}

size_t epuck_asercom_reply_len(const struct epuck_asercom_mode *mode)
{
    return 2u * mode->ring + PAIR_LEN + BATTERY_LEN + mode->ground + mode->epuck2 + PAIR_LEN;
}

int epuck_asercom_get_reply(const struct epuck_asercom_mode *mode, const uint8_t *reply,
                            struct epuck_asercom_sensors *sensors)
{
    struct epuck_asercom_sensors read = {{0}, {0}, {0}, 0, {0}, {0}, 0, 0, 0};
    const uint8_t *at = reply + 2u * mode->ring;
    int i;

    if (epuck_get_calibrated(reply, 8, read.prox) != 0 ||
        epuck_get_raw(reply + mode->ring, 8, 0, EPUCK_ASERCOM_RAW_MAX, read.light) != 0)
        return -1;
    read.steps[0] = epuck_get_u16(at);
    read.steps[1] = epuck_get_u16(at + 2);
    read.battery = epuck_get_u16(at + PAIR_LEN);
    at += PAIR_LEN + BATTERY_LEN;
    if (mode->epuck2 > 0) {
        for (i = 0; i < 3; i++, at += 2)
            read.rates[i] = epuck_get_s16(at);
        read.distance_mm = epuck_get_u16(at);
        at += DISTANCE_LEN;
    }
    if (mode->ground > 0 && epuck_get_raw(at, 3, 0, EPUCK_ASERCOM_RAW_MAX, read.ground) != 0)
        return -1;
    at += mode->ground;
    read.left_steps_s = epuck_get_s16(at);
    read.right_steps_s = epuck_get_s16(at + 2);
    *sensors = read;
    return 0;
}

uint16_t epuck_asercom_battery_mv(uint16_t raw, int is_epuck2)
{
    int32_t over = (int32_t)raw - BATTERY_LOW_RAW;

    if (raw <= BATTERY_FLAG_MAX || raw > EPUCK_ASERCOM_RAW_MAX)
        return 0;
    if (is_epuck2)
        return (uint16_t)((uint32_t)raw * EPUCK2_FULL_MV / EPUCK2_FULL_RAW);
    return (uint16_t)(BATTERY_LOW_MV + over * BATTERY_SPAN_MV / BATTERY_SPAN_RAW);
}

uint8_t epuck_asercom_battery_low(uint16_t raw, int is_epuck2)
{
    if (raw <= BATTERY_FLAG_MAX)
        return raw == 0;
    return epuck_asercom_battery_mv(raw, is_epuck2) < BATTERY_LOW_MV;
}
