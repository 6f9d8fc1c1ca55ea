/* SPDX-License-Identifier: MIT */
/*
 * vs_random.h - a random generator of NumPy's in C: the same numbers that its Generator gives.
 */
#ifndef VS_RANDOM_H
#define VS_RANDOM_H

/* Its own functions, and what each takes. */
struct vs_random {
    double (*next_double)(void *state); /* uniform in [0, 1) */
    void *state;
    double (*standard_normal)(void *bits);
    void *bits;
};

#endif
