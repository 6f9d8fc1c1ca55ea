/* SPDX-License-Identifier: MIT */
#include "epuck_york.h"

#include "epuck_bytes.h"

enum { OTHER_FRONT = 1, OTHER_BODY = 2, RING = 0xFF, LED_BODY = 0x100, LED_FRONT = 0x200 };

void epuck_york_put_write(uint8_t number, uint16_t value, uint8_t out[EPUCK_YORK_WRITE_LEN])
{
    out[0] = number;
    epuck_put_u16(out + 1, value);
}

uint16_t epuck_york_get_leds(uint16_t ring, uint16_t other)
{
    uint16_t leds = ring & RING;

    if (other & OTHER_FRONT)
        leds |= LED_FRONT;
    if (other & OTHER_BODY)
        leds |= LED_BODY;
    return leds;
}

uint16_t epuck_york_other_leds(uint16_t leds)
{
    uint16_t other = 0;

    if (leds & LED_FRONT)
        other |= OTHER_FRONT;
    if (leds & LED_BODY)
        other |= OTHER_BODY;
    return other;
}
