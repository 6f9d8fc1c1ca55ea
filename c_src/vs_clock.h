/* SPDX-License-Identifier: MIT */
/*
 * vs_clock.h - estimates how far the host's clock is ahead of the robot's, with a
 * bound that holds for any split of the delay between the two directions and any
 * drift up to VS_CLOCK_DRIFT_PPM. Each accepted packet of the host gives one
 * sample; the one with the smallest bound, aged, is kept.
 *
 * Both ends read CLOCK_MONOTONIC_RAW, which nobody slews. CLOCK_MONOTONIC may run up to
 * 10 % wrong while NTP corrects the calendar: a robot whose kernel has nothing better
 * says so, and its bound has room for that.
 */
#ifndef VS_CLOCK_H
#define VS_CLOCK_H

#include <stdint.h>

#include "vs_err.h"

#define VS_CLOCK_DRIFT_PPM 250 /* [ppm] largest drift between two clocks that nobody slews */

/* A slewed clock drifts by one in so many at the most. adjtimex() lets a tick be 10 % wrong and the
 * frequency 500 ppm, adjtime() 500 ppm more; of what the slow clock shows that is 11.3 %. Source:
 * Linux 6.1 kernel/time/ntp.c process_adjtimex_modes, MAX_TICKADJ; chrony uses 8.3 %. */
#define VS_CLOCK_SLEW_PART 8

/* Read-only for the caller; times in ns of the robot's monotonic clock. */
struct vs_clock {
    int64_t offset_ns; /* host's clock minus robot's at at_ns, modulo 2^64 */
    uint64_t bound_ns; /* |error of offset_ns| at at_ns is not larger */
    uint64_t at_ns;    /* when the sample was taken */
    uint32_t samples;  /* taken into account so far; 0 = nothing is known */
    uint8_t slewed;    /* the robot's clock may be slewed */
};

void vs_clock_init(struct vs_clock *c, int slewed);

/*
 * One sample: the robot sent at echo_ns (own clock); the host held that packet
 * for hold_us and answered at send_ns (its clock); the answer came at now_ns.
 * Errors: VS_ERR_ARGUMENT if echo_ns is 0 (none yet), lies in the future, or the
 * host claims to have held the packet for longer than it was away.
 */
int vs_clock_sample(struct vs_clock *c, uint64_t echo_ns, uint64_t send_ns,
                    uint32_t hold_us, uint64_t now_ns);

/* Whole microseconds. */
uint64_t vs_clock_us(uint64_t ns);

/* Estimate at now_ns. Errors: VS_ERR_STATE before the first sample. */
int vs_clock_estimate(const struct vs_clock *c, uint64_t now_ns,
                      int64_t *offset_ns, uint64_t *bound_ns);

#endif
