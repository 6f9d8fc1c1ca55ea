/* SPDX-License-Identifier: MIT */
/* vs_hearing_noise.h - what vs_hearing.c is told of how messages are disturbed. */
#ifndef VS_HEARING_NOISE_H
#define VS_HEARING_NOISE_H

#include "vs_hearing.h"

/* Puts, in place of the distances of those heard, 100 times their ranges, with all noise. */
void vs_hearing_disturb(const struct vs_hearing *hearing, uint32_t robots);

#endif
