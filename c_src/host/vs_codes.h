/* SPDX-License-Identifier: MIT */
/*
 * vs_codes.h - names arrows: which tag of a roster makes the cells that a picture shows. They are
 * compared with what a camera would see of each tag under the blur that the marker's edges have.
 * A marker is named only if one tag fits every cell and no other comes near. Where that is not so
 * by far, black, white and a slope of the light are fitted under blurs about the measured one, as
 * those of square markers are: in a glare, and where an edge's blur is hard to tell.
 */
#ifndef VS_CODES_H
#define VS_CODES_H

#include "vs_markers.h"

#define VS_CODES_BLURS 19 /* that words are prepared for, along the heading and across it */

/* A roster's code words. Made once; all threads may read them. */
struct vs_codes {
    int32_t cells;           /* of a marker, 1 .. VS_OUTLINE_CELLS */
    int32_t side;            /* how many of them are in a row */
    int32_t tags;            /* 0 .. */
    const int32_t *tag;
    const float *word;       /* [((ahead * VS_CODES_BLURS + left) * cells + cell) * tags + place of
                                the tag], from 0, true black, to 1, true white */
    const float *most_error; /* [(ahead * VS_CODES_BLURS + left) * tags + place of the tag] that a
                                marker of it may have */
    const float *per_length; /* [the same] 1 over the length of the word without mean and slope */
    double lost[VS_CODES_BLURS];  /* share of an edge's contrast beyond where it is measured */
    double sharp[VS_CODES_BLURS]; /* sharpness of an edge under each blur, falling */
};

/*
 * Names markers by cell, sharp_ahead and sharp_left: sets guess, the tag whose word
 * is nearest, -1 without tags; tag, the same, -1 where it is not sure; error, the root mean square
 * difference to that word; and margin, how many times farther the next tag's is. Where the light
 * was fitted, so it is for the difference.
 */
void vs_codes_name(const struct vs_codes *codes, struct vs_marker *markers, size_t count);

#endif
