/* SPDX-License-Identifier: MIT */
/*
 * driver_record.h - what a driver and its daemon write to each other: records of a fixed size,
 * little-endian, as DRIVERS.md lists them byte by byte. Times are of CLOCK_MONOTONIC [ns], the
 * same for both. Pure.
 */
#ifndef VS_DRIVER_RECORD_H
#define VS_DRIVER_RECORD_H

#include "base.h"

#define VS_DRIVER_VERSION 1
#define VS_DRIVER_ORDER_LEN 48
#define VS_DRIVER_REPORT_LEN 160
#define VS_DRIVER_RAYS 16 /* room for sensors of a ring; a base reads the first 8 */

enum { VS_DRIVER_END = 1 }; /* flags of an order: rest, LEDs off, and end */

enum { /* flags of a report: what it measures */
    VS_DRIVER_WAY = 1,
    VS_DRIVER_GROUND = 2,
    VS_DRIVER_ACCELERATION = 4,
    VS_DRIVER_RATES = 8,
    VS_DRIVER_DISTANCE = 16
};

struct vs_driver_order {
    uint32_t flags;
    uint64_t sent_ns;  /* its name, too: a report says which order it follows */
    uint64_t until_ns; /* wheels rest from then on, if nothing newer came */
    int32_t left_um_s, right_um_s;
    uint16_t leds;
    uint8_t rgb[VS_BASE_RGB_LEDS][3];
};

struct vs_driver_report {
    uint32_t flags;
    uint64_t order_ns;    /* sent_ns of the newest order that the robot has got */
    uint64_t measured_ns;
    int64_t way_um[2];    /* of the left and right wheel, since the driver began */
    uint16_t max_mm_s;    /* what its wheels can do, 0: not known */
    uint16_t battery_mv;  /* 0: not known */
    uint8_t battery_low;  /* 0, 1 or 255: not known */
    uint8_t rgb_leds;
    uint8_t rays[2];      /* of proximity and light; 0: there is none */
    uint16_t distance_mm;
    int16_t ground[3];       /* 0 black .. 1023 white */
    int16_t acceleration[3]; /* raw */
    int16_t rates_mrad_s[3];
    int16_t prox[VS_DRIVER_RAYS], light[VS_DRIVER_RAYS]; /* raw, 0 .. 4095 */
};

void vs_driver_put_order(const struct vs_driver_order *order, uint8_t buf[VS_DRIVER_ORDER_LEN]);

/* VS_OK; VS_ERR_MAGIC: it is no record, VS_ERR_VERSION: of another version, or VS_ERR_BODY: a
 * number in it cannot be. */
int vs_driver_get_report(const uint8_t buf[VS_DRIVER_REPORT_LEN], struct vs_driver_report *report);

#endif
