/* SPDX-License-Identifier: MIT */
/*
 * vs_slip.h - wheels that do not quite obey: ARGoS's noise of wheels. Speeds in step/s.
 */
#ifndef VS_SLIP_H
#define VS_SLIP_H

#include <stdint.h>

#include "vs_random.h"

/* Of the wheels of all robots; the arrays are [robots * 2], left and right, and the caller's. */
struct vs_slip {
    uint32_t robots;
    int32_t most_steps_s;     /* no motor turns faster */
    const double *relative;   /* standard deviation, as a share of the command */
    const double *factor;     /* of what comes of it, mean */
    const double *factor_dev; /* and standard deviation */
    const double *bias;       /* is added to it where the robot drives */
    struct vs_random *random;
    double *drawn;            /* scratch */
};

/* Puts the speeds at which robots drive in place of what their wheels are told, [robots * 2]. It
 * draws two numbers for each wheel: all of the first ones first. */
void vs_slip_apply(const struct vs_slip *slip, int16_t *wheels);

#endif
