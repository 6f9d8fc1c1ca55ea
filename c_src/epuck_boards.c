/* SPDX-License-Identifier: MIT */
#include "epuck_boards.h"

enum { BEARING_MAX = 31416, BEARING_LEN = 2, ADC_SHIFT = 4, ADC_MAX = 2047, ADC_UNIT_MV = 4 };

static uint16_t get_big(const uint8_t *at)
{
    return (uint16_t)((uint16_t)(at[0] << 8) | at[1]);
}

static void put_big(uint8_t *at, uint16_t value)
{
    at[0] = (uint8_t)(value >> 8);
    at[1] = (uint8_t)(value & 0xFFu);
}

int epuck_ground_get(const uint8_t registers[EPUCK_GROUND_LEN], int16_t ground[3])
{
    int i;

    for (i = 0; i < 3; i++)
        if (get_big(registers + 2 * i) > EPUCK_GROUND_MAX)
            return -1;
    for (i = 0; i < 3; i++)
        ground[i] = (int16_t)get_big(registers + 2 * i);
    return 0;
}

void epuck_ground_put(const int16_t ground[3], uint8_t registers[EPUCK_GROUND_LEN])
{
    int i;

    for (i = 0; i < 3; i++)
        put_big(registers + 2 * i, (uint16_t)ground[i]);
}

void epuck_rgb_put(const uint8_t rgb[EPUCK_RGB_LEDS][3], uint8_t out[EPUCK_RGB_LEN])
{
    int led;
    int i;

    for (led = EPUCK_RGB_LEDS - 1; led >= 0; led--)
        for (i = 0; i < 3; i++)
            *out++ = rgb[led][i];
}

void epuck_rgb_get(const uint8_t out[EPUCK_RGB_LEN], uint8_t rgb[EPUCK_RGB_LEDS][3])
{
    int led;
    int i;

    for (led = EPUCK_RGB_LEDS - 1; led >= 0; led--)
        for (i = 0; i < 3; i++)
            rgb[led][i] = *out++;
}

uint16_t epuck_adc_get_battery(const uint8_t value[2])
{
    uint16_t raw = (uint16_t)(get_big(value) >> ADC_SHIFT);

    return raw <= ADC_MAX ? (uint16_t)(raw * ADC_UNIT_MV) : 0; /* noise may be below 0 */
}

void epuck_adc_put_battery(uint16_t mv, uint8_t value[2])
{
    int raw = (mv + ADC_UNIT_MV / 2) / ADC_UNIT_MV;

    put_big(value, (uint16_t)((raw < ADC_MAX ? raw : ADC_MAX) << ADC_SHIFT));
}

const uint8_t *epuck_rab_reads(uint8_t size, size_t *count)
{
    static const uint8_t all[] = {EPUCK_RAB_DATA_3,       EPUCK_RAB_DATA_2,
                                  EPUCK_RAB_DATA_1,       EPUCK_RAB_DATA_0,
                                  EPUCK_RAB_BEARING_HIGH, EPUCK_RAB_BEARING_LOW,
                                  EPUCK_RAB_RANGE_HIGH,   EPUCK_RAB_RANGE_LOW};
    size_t left_out = 4u - size;

    *count = sizeof all - left_out;
    return all + left_out;
}

const uint8_t *epuck_rab_writes(uint8_t size)
{
    static const uint8_t two[] = {EPUCK_RAB_FIRST, EPUCK_RAB_SEND};
    static const uint8_t four[] = {EPUCK_RAB_FIRST, EPUCK_RAB_THEN, EPUCK_RAB_THEN_TOO,
                                   EPUCK_RAB_SEND};

    return size == 2 ? two : four;
}

int epuck_rab_get(const uint8_t *registers, uint8_t size, struct epuck_rab_message *message)
{
    int32_t bearing = get_big(registers + size);
    int i;

    if (bearing >= 0x8000)
        bearing -= 0x10000;
    if (bearing > BEARING_MAX || bearing < -BEARING_MAX)
        return -1;
    for (i = 0; i < 4; i++)
        message->data[i] = i < size ? registers[size - 1 - i] : 0;
    message->bearing_e4rad = (int16_t)bearing;
    message->range_raw = get_big(registers + size + BEARING_LEN);
    return 0;
}

void epuck_rab_put(const struct epuck_rab_message *message, uint8_t size, uint8_t *registers)
{
    int i;

    for (i = 0; i < size; i++)
        registers[size - 1 - i] = message->data[i];
    put_big(registers + size, (uint16_t)message->bearing_e4rad);
    put_big(registers + size + BEARING_LEN, message->range_raw);
}
