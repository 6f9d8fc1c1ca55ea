/* SPDX-License-Identifier: MIT */
/*
 * battery.h - when a robot has to stand still because its battery is nearly empty. A motor that
 * starts pulls the voltage down for a moment, and it rises when the robot stops: so it has to be
 * low for a while, and to rise by a good deal before the robot drives again. Pure.
 */
#ifndef VS_BATTERY_H
#define VS_BATTERY_H

#include <stdint.h>

#define VS_BATTERY_LOW_NS UINT64_C(3000000000) /* [ns] that it is low before it counts as empty */
#define VS_BATTERY_CHARGED_MV 200 /* [mV] above the limit it counts as charged */

struct vs_battery {
    uint16_t stop_mv; /* [mV] the limit, 0: the robot never stops for it */
    uint8_t empty;    /* 1: it has to stand still */
    uint8_t low;      /* 1: it is low since low_ns */
    uint64_t low_ns;
};

/* A measurement: mv, 0 = not known; then low, 0, 1 or VS_UNKNOWN, counts, of a base that only
 * says that, and what was empty stays so. Neither known: as if nothing was measured. Returns
 * battery->empty. */
int vs_battery_look(struct vs_battery *battery, uint16_t mv, uint8_t low, uint64_t now_ns);

#endif
