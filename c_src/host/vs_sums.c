/* SPDX-License-Identifier: MIT */
#include "vs_sums.h"

#include <string.h>

void vs_sums_rows(const struct vs_words *w, const vs_line *cell, int blur, vs_line *lines)
{
    int i, row;

    for (i = 0; i < w->cells + 2; i++) {
        memset(lines[i], 0, sizeof lines[i]);
        for (row = 0; row < w->cells + 4; row++)
            vs_sums_line(lines[i], w->seen[blur][row][i], cell[row]);
    }
}

/* Four sums with a cell more than four others. */
static inline void add_cell(float *restrict to, const float *restrict from, float more)
{
    int i;

    for (i = 0; i < 4; i++)
        to[i] = from[i] + more;
}

/* Writes the sums of the weights of white cells, for all values of each part of a word. */
static void add_up(const float *weight, int bits, struct vs_sums *sums)
{
    int part, value, bit;

    sums->parts = (bits + VS_WORDS_PART - 1) / VS_WORDS_PART;
    for (part = 0; part < sums->parts; part++) {
        float *sum = sums->part[part], more[VS_WORDS_PART];

        for (bit = 0; bit < VS_WORDS_PART; bit++) {
            int place = part * VS_WORDS_PART + bit;

            more[bit] = place < bits ? weight[place] : 0.0F;
        }
        sum[0] = 0.0F;
        sum[1] = more[0];
        sum[2] = more[1];
        sum[3] = more[0] + more[1];
        for (bit = 2; bit < VS_WORDS_PART; bit++) {
            for (value = 0; value < 1 << bit; value += 4)
                add_cell(&sum[(1 << bit) + value], &sum[value], more[bit]);
        }
    }
}

void vs_sums_weigh(const struct vs_words *w, const vs_line *lines, int blur,
                   struct vs_sums *sums)
{
    float weight[VS_WORDS_CELLS * VS_WORDS_CELLS];
    int side = w->cells + 2, i, k;

    sums->constant = 0.0F;
    for (i = 0; i < side; i++) {
        vs_line all;

        memset(all, 0, sizeof all);
        for (k = 0; k < side + 2; k++)
            vs_sums_line(all, lines[i][k], w->seen[blur][k]);
        for (k = 0; k < side; k++)
            sums->constant -= all[k];
        if (i > 0 && i < side - 1)
            memcpy(&weight[(i - 1) * w->cells], &all[1], (size_t)w->cells * sizeof all[0]);
    }
    add_up(weight, w->cells * w->cells, sums);
}

/* A loop over parts whose number the compiler knows has no loop left. */
static inline void add_words(const struct vs_sums *sums, const uint8_t *part, int parts,
                             int count, float *sum)
{
    int word, i;

    for (word = 0; word < count; word++, part += parts) {
        float all = sums->constant;

#pragma GCC unroll 6
        for (i = 0; i < parts; i++)
            all += sums->part[i][part[i]];
        sum[word] = all;
    }
}

void vs_sums_add(const struct vs_sums *sums, const uint8_t *part, int count, float *sum)
{
    switch (sums->parts) {
    case 3: /* 4 x 4 cells */
        add_words(sums, part, 3, count, sum);
        break;
    case 6: /* 6 x 6 cells */
        add_words(sums, part, 6, count, sum);
        break;
    default:
        add_words(sums, part, sums->parts, count, sum);
        break;
    }
}
