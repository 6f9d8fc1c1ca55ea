/* SPDX-License-Identifier: MIT */
/*
 * vs_cxx.h - calls loop functions in C++ that are in this process; robot/argos/loop_functions.cpp
 * says in which words. Lengths in m, arena frame.
 */
#ifndef VS_CXX_H
#define VS_CXX_H

#include <stddef.h>
#include <stdint.h>

#include "vs_world.h"

/* Functions that are called in every timestep, in this order, and that of the floor. */
#define VS_CXX_PRE_STEP 0
#define VS_CXX_POST_STEP 1
#define VS_CXX_IS_FINISHED 2
#define VS_CXX_FLOOR 3
#define VS_CXX_FUNCTIONS 4

#define VS_CXX_SAID 1   /* the answer is more than nothing */
#define VS_CXX_SHINES 2 /* robots' LEDs have changed: it was not called, as this is said in words */

/* As robot/argos/loop_functions.hpp has it. */
struct vs_cxx_answer {
    const char *text;
    size_t text_size;
    const unsigned char *colors;
    size_t color_count;
};

/* All arrays are the caller's. */
struct vs_cxx {
    void (*call)(const char *text, size_t size, const double *numbers, size_t count,
                 struct vs_cxx_answer *answer);
    struct vs_cxx_answer answer; /* the newest one */
    volatile uint32_t *note;      /* [3] who runs, for others: timestep, 1 or 0, and one of these */
    uint32_t numbers[VS_CXX_FUNCTIONS];
    const struct vs_world *world; /* all robots */
    double *places;               /* [all robots * 3] scratch */
    const uint8_t *colors;        /* [color_bytes] LEDs as they are, and as they were told */
    const uint8_t *told;
    size_t color_bytes;
    int answers;                  /* 0: they are gone, and ask says the floor's colours */
    int (*ask)(void *whom, const double *points_m, uint32_t n, double *colors);
    int (*hear)(void *whom);      /* takes what the floor's answer says; VS_OK or an error */
};

/* What struct vs_floor asks; loop is a struct vs_cxx. Errors: those of ask and hear. */
int vs_cxx_paint(void *loop, const double *points_m, uint32_t n, double *colors);

#endif
