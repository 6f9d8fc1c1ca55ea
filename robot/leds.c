/* SPDX-License-Identifier: MIT */
#include "leds.h"

#include "robot.h"

void vs_robot_set_leds(struct vs_robot *robot, unsigned int leds)
{
    robot->command.leds = (uint16_t)(leds & VS_BASE_LEDS);
}

static uint8_t narrow(int brightness)
{
    if (brightness > UINT8_MAX)
        return UINT8_MAX;
    return (uint8_t)(brightness < 0 ? 0 : brightness);
}

int vs_robot_rgb_leds(const struct vs_robot *robot)
{
    const struct vs_base_reading *base = &robot->base;

    return base->boards.there >> VS_BOARD_RGB & 1 ? EPUCK_RGB_LEDS : base->rgb_leds;
}

void vs_robot_set_rgb(struct vs_robot *robot, int led, int red, int green, int blue)
{
    uint8_t *rgb;

    if (led < 0 || led >= VS_BASE_RGB_LEDS)
        return;
    rgb = robot->command.rgb[led];
    rgb[0] = narrow(red);
    rgb[1] = narrow(green);
    rgb[2] = narrow(blue);
}
