/* SPDX-License-Identifier: MIT */
#include "vs_codes.h"

#include "vs_edges.h"
#include "vs_math.h"

#define TOGETHER 64 /* tags whose sums lie in registers and the first cache */
#define WORST_CELL 0.40f
#define LEAST_MARGIN 1.6
#define GREATEST_ERROR 1.0
#define LEAST_ERROR 1e-3 /* that margins are told of */

/* The nearest words so far, by the sum of their cells' squared differences. */
struct nearest {
    int32_t place;
    float sum, next;
};

/* Compares cells with some tags' words, one column of them after the other. */
static void compare(const float *cells, int32_t count, const float *word, int32_t tags,
                    int32_t begin, int32_t end, struct nearest *nearest)
{
    float sum[TOGETHER] = {0.0f};
    int32_t cell, i;

    for (cell = 0; cell < count; cell++) {
        const float *column = word + (size_t)cell * (size_t)tags + begin;
        float seen = cells[cell];

        for (i = 0; i < end - begin; i++) {
            float off = seen - column[i];

            sum[i] += off * off;
        }
    }
    for (i = 0; i < end - begin; i++) {
        float farther = sum[i];

        if (nearest->place < 0 || sum[i] < nearest->sum) {
            farther = nearest->place < 0 ? nearest->next : nearest->sum;
            nearest->sum = sum[i];
            nearest->place = begin + i;
        }
        if (farther < nearest->next)
            nearest->next = farther;
    }
}

/* Whether every cell is near to its word's. */
static int is_alike(const float *cells, int32_t count, const float *word, int32_t tags)
{
    int32_t i;

    for (i = 0; i < count; i++) {
        float off = cells[i] - word[(size_t)i * (size_t)tags];

        if (!(off < WORST_CELL && -off < WORST_CELL))
            return 0;
    }
    return 1;
}

static void name(const struct vs_codes *codes, struct vs_marker *marker)
{
    int32_t tags = codes->tags, begin, i;
    int32_t ahead = vs_edges_level(codes->sharp, VS_CODES_BLURS, marker->sharp_ahead);
    int32_t left = vs_edges_level(codes->sharp, VS_CODES_BLURS, marker->sharp_left);
    size_t kind = (size_t)(ahead * VS_CODES_BLURS + left) * (size_t)tags;
    const float *word = codes->word + kind * (size_t)codes->cells;
    double lost = 0.5 * (codes->lost[ahead] + codes->lost[left]), next;
    struct nearest nearest = {-1, 0.0f, (float)(GREATEST_ERROR * GREATEST_ERROR)};
    float cells[VS_OUTLINE_CELLS];

    /* Cells are told between what was measured near to blurred edges, where black is not black. */
    for (i = 0; i < codes->cells; i++)
        cells[i] = (float)((1.0 - 2.0 * lost) * marker->cell[i] + lost);
    nearest.next *= (float)codes->cells;
    for (begin = 0; begin < tags; begin += TOGETHER) {
        int32_t end = begin + TOGETHER < tags ? begin + TOGETHER : tags;

        compare(cells, codes->cells, word, tags, begin, end, &nearest);
    }
    marker->tag = marker->guess = -1.0;
    marker->error = marker->margin = GREATEST_ERROR;
    if (nearest.place < 0)
        return;
    marker->guess = codes->tag[nearest.place];
    marker->error = vs_root((double)nearest.sum / codes->cells);
    next = vs_root((double)nearest.next / codes->cells);
    marker->margin = next / (marker->error > LEAST_ERROR ? marker->error : LEAST_ERROR);
    if (marker->margin > LEAST_MARGIN &&
        marker->error < (double)codes->most_error[kind + (size_t)nearest.place] &&
        is_alike(cells, codes->cells, word + nearest.place, tags))
        marker->tag = marker->guess;
}

void vs_codes_name(const struct vs_codes *codes, struct vs_marker *markers, size_t count)
{
    size_t i;

    for (i = 0; i < count; i++)
        name(codes, &markers[i]);
}
