/* SPDX-License-Identifier: MIT */
#include "epuck_bytes.h"

enum { ADC_MAX = 4095 }; /* of 12 bits */

void epuck_put_u16(uint8_t at[2], uint16_t value)
{
    at[0] = (uint8_t)(value & 0xFFu);
    at[1] = (uint8_t)(value >> 8);
}

uint16_t epuck_get_u16(const uint8_t at[2])
{
    return (uint16_t)(at[0] | (uint16_t)(at[1] << 8));
}

int16_t epuck_get_s16(const uint8_t at[2])
{
    int32_t value = epuck_get_u16(at);

    return (int16_t)(value < 0x8000 ? value : value - 0x10000);
}

int epuck_get_raw(const uint8_t *at, int count, int least, int most, int16_t *raw)
{
    const uint8_t *end = at + 2 * count;
    uint32_t span = (uint32_t)(most - least) << 16;
    int bad = 0;

    /* How far above least is counted in the upper half of a word, where it wraps below it. */
    for (; at != end; at += 2, raw++) {
        uint32_t value = epuck_get_u16(at);

        *raw = (int16_t)(value < 0x8000 ? (int32_t)value : (int32_t)value - 0x10000);
        bad |= (value - (uint32_t)least) << 16 > span;
    }
    return -bad;
}

int epuck_get_calibrated(const uint8_t *at, int count, int16_t *prox)
{
    int i;

    if (epuck_get_raw(at, count, 0, 2 * ADC_MAX, prox) != 0)
        return -1;
    for (i = 0; i < count; i++)
        prox[i] = prox[i] < ADC_MAX ? prox[i] : ADC_MAX;
    return 0;
}

void epuck_zero(uint8_t *at, size_t len)
{
    size_t i;

    for (i = 0; i < len; i++)
        at[i] = 0;
}

uint8_t epuck_xor(const uint8_t *at, size_t len)
{
    uint8_t sum = 0;
    size_t i;

    for (i = 0; i < len; i++)
        sum ^= at[i];
    return sum;
}

uint8_t epuck_or(const uint8_t *at, size_t len)
{
    uint8_t any = 0;
    size_t i;

    for (i = 0; i < len; i++)
        any |= at[i];
    return any;
}
