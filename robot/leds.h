/* SPDX-License-Identifier: MIT */
/* leds.h - a robot's LEDs as controllers light them: the red ones of every e-puck, and coloured
 * ones where it has some. Pure. */
#ifndef VS_LEDS_H
#define VS_LEDS_H

#include <string.h>

#include "base.h"

/* All of them off. */
static inline void vs_leds_off(struct vs_base_command *command)
{
    command->leds = 0;
    memset(command->rgb, 0, sizeof command->rgb);
}

#endif
