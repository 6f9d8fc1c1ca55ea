/* SPDX-License-Identifier: MIT */
#include "fw_watchdog.h"

void fw_watchdog_feed(struct fw_watchdog *watchdog, uint16_t ticks)
{
    watchdog->left = ticks;
}

int fw_watchdog_tick(struct fw_watchdog *watchdog)
{
    uint16_t left = watchdog->left;

    if (left == 0)
        return 0;
    left--;
    watchdog->left = left;
    return left == 0;
}
