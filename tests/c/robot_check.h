/* SPDX-License-Identifier: MIT */
/* robot_check.h - what the robot's C tests share: a check, and a random generator. */
#ifndef ROBOT_CHECK_H
#define ROBOT_CHECK_H

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#define CHECK(condition)                                                             \
    do {                                                                             \
        if (!(condition)) {                                                          \
            fprintf(stderr, "%s:%d: %s: not so: %s\n", __FILE__, __LINE__, __func__, \
                    #condition);                                                     \
            exit(1);                                                                 \
        }                                                                            \
    } while (0)

/* xorshift32; *state must not be 0. Uniform in 0..below-1, nearly. */
static inline uint32_t draw(uint32_t *state, uint32_t below)
{
    *state ^= *state << 13;
    *state ^= *state >> 17;
    *state ^= *state << 5;
    return *state % below;
}

#endif
