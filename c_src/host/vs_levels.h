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

/* Whether a pixel is as light as this. */
int vs_levels_reach(const struct vs_scan *s, int32_t light);

/*
 * Sets each block's level from the extremes of the 3 x 3 blocks around it, where the lightest of
 * them is light enough; see struct vs_search.
 */
void vs_levels_set(struct vs_scan *s, const struct vs_search *search, int32_t level_256,
                   int32_t least_light);

#endif
