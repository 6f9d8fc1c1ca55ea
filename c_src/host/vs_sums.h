/* SPDX-License-Identifier: MIT */
/*
 * vs_sums.h - how alike cells are to every word of a dictionary under one blur: sums of weights
 * of a word's white cells, looked up a part of the word at a time.
 */
#ifndef VS_SUMS_H
#define VS_SUMS_H

#include "vs_words.h"

#define VS_SUMS_PARTS 11  /* of a word of 64 bits */
#define VS_SUMS_VALUES 64 /* of a part: 2^VS_WORDS_PART */

/* A row of cells, 0 beyond its end: loops of a fixed length are short ones of vectors. */
typedef float vs_line[VS_WORDS_SPAN];

/* A word's likeness is constant + the sum over its parts, over its length. */
struct vs_sums {
    int parts;
    float constant;
    float part[VS_SUMS_PARTS][VS_SUMS_VALUES];
};

/* to += share * from. */
static inline void vs_sums_line(float *to, float share, const float *from)
{
    int i;

    for (i = 0; i < VS_WORDS_SPAN; i++)
        to[i] += share * from[i];
}

/* Carries the columns' blur over from words to cells, a line for each row of the square. */
void vs_sums_rows(const struct vs_words *words, const vs_line *cell, int blur, vs_line *lines);

/* Carries the rows' blur over, too: one set of weights does for all words. */
void vs_sums_weigh(const struct vs_words *words, const vs_line *lines, int blur,
                   struct vs_sums *sums);

/* The sums of count words; part has theirs one after the other, see struct vs_words. */
void vs_sums_add(const struct vs_sums *sums, const uint8_t *part, int count, float *sum);

#endif
