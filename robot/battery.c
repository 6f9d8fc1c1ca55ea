/* SPDX-License-Identifier: MIT */
#include "battery.h"

int vs_battery_look(struct vs_battery *battery, uint16_t mv, uint8_t low, uint64_t now_ns)
{
    int is_low = mv != 0 ? mv < battery->stop_mv : low == 1;

    if (battery->stop_mv == 0)
        return 0;
    if (mv == 0 && low > 1)
        return battery->empty;
    if (is_low && !battery->low)
        battery->low_ns = now_ns;
    battery->low = (uint8_t)is_low;
    if (is_low && now_ns - battery->low_ns >= VS_BATTERY_LOW_NS)
        battery->empty = 1;
    else if (mv >= battery->stop_mv + VS_BATTERY_CHARGED_MV)
        battery->empty = 0;
    return battery->empty;
}
