/* SPDX-License-Identifier: MIT */
/*
 * vs_words.h - reads square markers: which word of a dictionary, turned how, makes the
 * cells that a picture shows. They are compared with what a camera would see of the words under
 * the blur that the marker's edges have; black, white and a slope of the light are fitted.
 */
#ifndef VS_WORDS_H
#define VS_WORDS_H

#include "vs_markers.h"

#define VS_WORDS_CELLS 8    /* of a matrix, per side */
#define VS_WORDS_SPAN 12    /* with the black frame and the white around it */
#define VS_WORDS_PART 6     /* bits of a word that are looked up at once */
#define VS_WORDS_BLURS 6    /* that words are prepared for, along each axis */
#define VS_WORDS_KINDS 36   /* BLURS * BLURS: a blur along the rows, one along the columns */

/* A dictionary. Made once; all threads may read it. */
struct vs_words {
    int32_t cells;          /* of the matrix, per side, 1 .. VS_WORDS_CELLS */
    int32_t tags;           /* 1 .. */
    int32_t correction;     /* wrong cells that a word may have */
    const uint64_t *word;   /* [4 * tag + quarter turns counter-clockwise], bit k is the cell at
                               row k / cells and column k % cells, 1 where white */
    const uint8_t *part;    /* [that number * parts + i] bits i * VS_WORDS_PART .. of a word,
                               (cells^2 + VS_WORDS_PART - 1) / VS_WORDS_PART of them */
    const float *per_length[2]; /* [kind * tags + tag] 1 over the length of upright words as they
                               are seen, without mean and slope; without and with the white */
    double least_match[2][VS_WORDS_KINDS]; /* correlation that chance hardly reaches */
    float seen[VS_WORDS_BLURS][VS_WORDS_SPAN][VS_WORDS_SPAN]; /* what each cell of a line has
                               of the light of each cell of the black square's, then zeros */
    double sharp[VS_WORDS_BLURS]; /* sharpness of an edge under each blur, falling */
    double cell_m;
    double turn_x, turn_y;     /* unit vector: the heading, seen from upright */
    double centre_x_m, centre_y_m; /* of the disc, seen from the square's: ahead, to the left */
};

/* What a marker's cells say. */
struct vs_reading {
    double error;  /* root mean square difference to the word, black to white being 1 */
    double margin; /* how many times larger that is for the next tag's best word */
    int32_t tag;   /* of the nearest word; -1: none is near */
    int32_t turn;  /* its quarter turns, counter-clockwise */
    int32_t sure;  /* whether it is to be believed */
};

/*
 * Reads the cells of count squares: grey values row by row, (cells + 4)^2 of each, with the white
 * around. level has their blurs along the rows and along the columns, two of each, as places in
 * the tables, 0 .. VS_WORDS_BLURS - 1.
 */
void vs_words_read(const struct vs_words *words, const float *cells, const int32_t *level,
                   size_t count, struct vs_reading *readings);

#endif
