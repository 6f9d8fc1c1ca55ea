/* SPDX-License-Identifier: MIT */
/*
 * vs_levels.h - the local threshold of a scan: the extremes of blocks of the picture, and from
 * those of a block and its neighbours where something is printed, and below which grey.
 */
#ifndef VS_LEVELS_H
#define VS_LEVELS_H

#include "vs_scan.h"

/* Measures the blocks' darkest and lightest pixels; line and lines are set. */
void vs_levels_measure(struct vs_scan *s, const struct vs_picture *picture);

/* Sets each block's level from the extremes of the 3 x 3 blocks around it; see struct vs_search. */
void vs_levels_set(struct vs_scan *s, const struct vs_search *search, int32_t level_256);

#endif
