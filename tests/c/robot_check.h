/* SPDX-License-Identifier: MIT */
/* robot_check.h - check.h and a random generator, for the robot's C tests. */
#ifndef ROBOT_CHECK_H
#define ROBOT_CHECK_H

#include <stdint.h>

#include "check.h"

/* xorshift32; *state must not be 0. Uniform in 0..below-1, nearly. */
static inline uint32_t draw(uint32_t *state, uint32_t below)
{
    *state ^= *state << 13;
    *state ^= *state >> 17;
    *state ^= *state << 5;
    return *state % below;
}

#endif
