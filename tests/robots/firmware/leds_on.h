/* Which LEDs are on, by the pins' names, which all e-puck firmware shares; after its header of pins. */
#ifndef LEDS_ON_H
#define LEDS_ON_H

/* Bits 0-7 ring, 8 body, 9 front. */
static int leds_on(void)
{
    return LED0 | LED1 << 1 | LED2 << 2 | LED3 << 3 | LED4 << 4 | LED5 << 5 | LED6 << 6 | LED7 << 7
           | BODY_LED << 8 | FRONT_LED << 9;
}

#endif
