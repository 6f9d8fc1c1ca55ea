/* SPDX-License-Identifier: MIT */
#include "vs_clock.h"

#include <string.h>

enum {
    DRIFT_PART = 1000000 / VS_CLOCK_DRIFT_PPM, /* clocks drift apart by one in so many */
    IS_4000 = 1 / (1000000 == 4000 * VS_CLOCK_DRIFT_PPM)
};

/* n / (125 << shift). The processors of robots have no division, but a multiplication:
 * 2^38 / 125, rounded up, is exact for 32 bits. */
static uint64_t divided(uint64_t n, unsigned int shift)
{
    uint64_t units = n >> shift;

    return units <= UINT32_MAX ? (units * 2199023256u) >> 38 : units / 125u;
}

/* What the two clocks can drift apart in elapsed_ns, rounded up. */
static uint64_t drift_ns(const struct vs_clock *c, uint64_t elapsed_ns)
{
    uint64_t whole_ns = divided(elapsed_ns, 5);
    uint64_t apart_ns = whole_ns + (whole_ns * DRIFT_PART != elapsed_ns);

    return c->slewed ? apart_ns + elapsed_ns / VS_CLOCK_SLEW_PART + 1 : apart_ns;
}

uint64_t vs_clock_us(uint64_t ns)
{
    return divided(ns, 3);
}

/* a - b modulo 2^64 as a signed number, without a conversion that C leaves to the
 * compiler. */
static int64_t difference(uint64_t a, uint64_t b)
{
    uint64_t d = a - b;

    return d <= INT64_MAX ? (int64_t)d : -(int64_t)(UINT64_MAX - d) - 1;
}

void vs_clock_init(struct vs_clock *c, int slewed)
{
    memset(c, 0, sizeof *c);
    c->slewed = (uint8_t)slewed;
}

/*
 * With elapsed = now - echo on the robot's clock and hold on the host's, the two
 * ways took elapsed - hold together, but for what the clocks drifted meanwhile
 * and the microsecond that hold is cut to. The answer took between nothing and
 * all of it, so the middle is wrong by at most half of it, plus that slack.
 */
int vs_clock_sample(struct vs_clock *c, uint64_t echo_ns, uint64_t send_ns,
                    uint32_t hold_us, uint64_t now_ns)
{
    uint64_t elapsed_ns = now_ns - echo_ns;
    uint64_t hold_ns = (uint64_t)hold_us * 1000;
    uint64_t slack_ns = drift_ns(c, elapsed_ns) + 1000;
    uint64_t both_ways_ns;
    uint64_t bound_ns;

    if (echo_ns == 0 || elapsed_ns > INT64_MAX || hold_ns > elapsed_ns + slack_ns)
        return VS_ERR_ARGUMENT;
    both_ways_ns = elapsed_ns > hold_ns ? elapsed_ns - hold_ns : 0;
    bound_ns = both_ways_ns / 2 + slack_ns;
    if (c->samples == 0 || bound_ns <= c->bound_ns ||
        bound_ns <= c->bound_ns + drift_ns(c, now_ns - c->at_ns)) {
        c->offset_ns = difference(send_ns + both_ways_ns / 2, now_ns);
        c->bound_ns = bound_ns;
        c->at_ns = now_ns;
    }
    if (c->samples < UINT32_MAX)
        c->samples++;
    return VS_OK;
}

int vs_clock_estimate(const struct vs_clock *c, uint64_t now_ns,
                      int64_t *offset_ns, uint64_t *bound_ns)
{
    if (c->samples == 0)
        return VS_ERR_STATE;
    *offset_ns = c->offset_ns;
    *bound_ns = c->bound_ns + drift_ns(c, now_ns - c->at_ns);
    return VS_OK;
}
