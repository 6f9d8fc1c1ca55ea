/* SPDX-License-Identifier: MIT */
/*
 * driver.h - what the guard does for a base that is a driver (driver.c): it says until when the
 * wheels may turn, and learns how old readings are. A daemon for the oldest boards has no such
 * base, and none of this. Pure.
 */
#ifndef VS_DRIVER_H
#define VS_DRIVER_H

#include "base.h"

/* For the exchanges from here on. */
static inline void vs_driver_until(struct vs_base *base, uint64_t until_ns)
{
#ifdef VSENSED_DRIVERS
    base->until_ns = until_ns;
#else
    (void)base;
    (void)until_ns;
#endif
}

/* [ns] how old a reading was when it came. */
static inline uint64_t vs_driver_age_ns(const struct vs_base_reading *reading)
{
#ifdef VSENSED_DRIVERS
    return (uint64_t)reading->age_us * 1000u;
#else
    (void)reading; /* what comes over a cable is new */
    return 0;
#endif
}

#endif
