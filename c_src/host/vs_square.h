/* SPDX-License-Identifier: MIT */
/*
 * vs_square.h - a square marker has its outline fitted about its middle, in any of four turns;
 * its word says which of them is upright, and from there the disc that carries it follows.
 */
#ifndef VS_SQUARE_H
#define VS_SQUARE_H

#include "vs_markers.h"

/*
 * Names a square that has been fitted, its pose being that of the square's middle and of any of
 * its sides; then it is that of the disc. Without a name it stays turned as it was.
 */
void vs_square_name(const struct vs_words *words, const struct vs_view *view,
                    struct vs_marker *marker);

/* Makes the disc's pose that of the upright square. */
void vs_square_upright(const struct vs_words *words, struct vs_marker *marker);

#endif
