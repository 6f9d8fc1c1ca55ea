/* SPDX-License-Identifier: MIT */
#include "vs_codes.h"

#include "vs_edges.h"
#include "vs_math.h"

#define TOGETHER 64 /* tags whose sums lie in registers and the first cache */
#define WORST_CELL 0.40f
#define LEAST_MARGIN 1.6
#define GREATEST_ERROR 1.0
#define LEAST_ERROR 1e-3 /* that margins are told of */
#define PLAIN_MARGIN 4.0 /* from which the light need not be fitted */
#define BLUR_STEP 4      /* levels to the blurs that are tried beside the measured one */
#define LEAST_LIKENESS 0.95f
#define LEAST_FITTED 2.5 /* margin where the light is fitted: four numbers more */
#define LEAST_GAIN 0.45f /* of the contrast at the edges: the cells', in a glare */
#define MOST_GAIN 2.0f

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

/* Cells as they are compared where the light is fitted, and the word that is likest to them. */
struct fitted {
    float cell[VS_OUTLINE_CELLS]; /* without mean and slope */
    float length;
    int32_t place, kind;
    float likeness, next; /* cosines: of that word, and the greatest of another tag's */
    double error, margin;
};

/* Takes mean and slope out of cells that lie stride apart; returns their length then. */
static float flatten(const struct vs_codes *codes, const float *cells, size_t stride, float *flat)
{
    float sum = 0.0f, along = 0.0f, down = 0.0f, places = 1e-6f, squares = 0.0f;
    float middle = 0.5f * (float)(codes->side - 1);
    int32_t i;

    for (i = 0; i < codes->cells; i++) {
        float x = (float)(i % codes->side) - middle, y = (float)(i / codes->side) - middle;
        float cell = cells[(size_t)i * stride];

        sum += cell;
        along += x * cell;
        down += y * cell;
        places += x * x;
    }
    for (i = 0; i < codes->cells; i++) {
        float x = (float)(i % codes->side) - middle, y = (float)(i / codes->side) - middle;

        flat[i] = cells[(size_t)i * stride] - sum / (float)codes->cells -
                  (x * along + y * down) / places;
        squares += flat[i] * flat[i];
    }
    return (float)vs_root((double)squares);
}

/* Keeps the greater of the likenesses of some tags' words, under one blur more. */
static void liken(const struct vs_codes *codes, const struct fitted *fitted, int32_t kind,
                  int32_t begin, int32_t end, float *likeness, int32_t *under)
{
    size_t tags = (size_t)codes->tags;
    const float *word = codes->word + (size_t)kind * tags * (size_t)codes->cells + begin;
    const float *per_length = codes->per_length + (size_t)kind * tags + begin;
    float sum[TOGETHER] = {0.0f};
    int32_t cell, i;

    for (cell = 0; cell < codes->cells; cell++) {
        const float *column = word + (size_t)cell * tags;
        float seen = fitted->cell[cell];

        for (i = 0; i < end - begin; i++)
            sum[i] += seen * column[i];
    }
    for (i = 0; i < end - begin; i++) {
        float alike = sum[i] * per_length[i] / fitted->length;

        if (alike > likeness[i]) {
            likeness[i] = alike;
            under[i] = kind;
        }
    }
}

/* Compares flat cells with some tags' words under the blurs about the measured one. */
static void compare_fitted(const struct vs_codes *codes, int32_t ahead, int32_t left,
                           int32_t begin, int32_t end, struct fitted *fitted)
{
    float likeness[TOGETHER] = {0.0f};
    int32_t under[TOGETHER] = {0};
    int32_t u, v, i;

    for (u = ahead - BLUR_STEP; u <= ahead + BLUR_STEP; u += BLUR_STEP) {
        for (v = left - BLUR_STEP; v <= left + BLUR_STEP; v += BLUR_STEP) {
            if (u >= 0 && v >= 0 && u < VS_CODES_BLURS && v < VS_CODES_BLURS)
                liken(codes, fitted, u * VS_CODES_BLURS + v, begin, end, likeness, under);
        }
    }
    for (i = 0; i < end - begin; i++) {
        float farther = likeness[i];

        if (likeness[i] > fitted->likeness) {
            farther = fitted->likeness;
            fitted->likeness = likeness[i];
            fitted->place = begin + i;
            fitted->kind = under[i];
        }
        if (farther > fitted->next)
            fitted->next = farther;
    }
}

/* Sets error and margin of the likest word; tells whether it is what the cells show. */
static int is_fitted(const struct vs_codes *codes, struct fitted *fitted)
{
    size_t tags = (size_t)codes->tags;
    const float *word = codes->word + (size_t)fitted->kind * tags * (size_t)codes->cells;
    double likeness = (double)fitted->likeness, next = (double)fitted->next, left;
    float ideal[VS_OUTLINE_CELLS], length, gain, off, worst = 0.0f;
    int32_t i;

    length = flatten(codes, word + fitted->place, tags, ideal);
    gain = fitted->likeness * fitted->length / (length > 1e-6f ? length : 1e-6f);
    for (i = 0; i < codes->cells; i++) {
        off = fitted->cell[i] - gain * ideal[i];
        off = off < 0.0f ? -off : off;
        worst = off > worst ? off : worst;
    }
    left = vs_root(1.0 - likeness * likeness > 1e-9 ? 1.0 - likeness * likeness : 1e-9);
    fitted->margin = vs_root(1.0 - next * next > 0.0 ? 1.0 - next * next : 0.0) / left;
    fitted->error = left * (double)length / vs_root((double)codes->cells);
    return fitted->likeness > LEAST_LIKENESS && fitted->margin > LEAST_FITTED &&
           gain > LEAST_GAIN && gain < MOST_GAIN && worst < WORST_CELL * gain;
}

/* Names cells by the form of their word alone, whatever the light; -1: it is nobody's. */
static int32_t name_fitted(const struct vs_codes *codes, const float *cells, int32_t ahead,
                           int32_t left, struct fitted *fitted)
{
    int32_t tags = codes->tags, begin;

    fitted->place = -1;
    fitted->likeness = fitted->next = 0.0f;
    fitted->length = flatten(codes, cells, 1, fitted->cell);
    if (!(fitted->length > 1e-6f))
        return -1;
    for (begin = 0; begin < tags; begin += TOGETHER) {
        int32_t end = begin + TOGETHER < tags ? begin + TOGETHER : tags;

        compare_fitted(codes, ahead, left, begin, end, fitted);
    }
    return fitted->place >= 0 && is_fitted(codes, fitted) ? fitted->place : -1;
}

/* The nearest word under the blur that was measured, black and white being those at the edges. */
static void find_nearest(const struct vs_codes *codes, const float *cells, size_t kind,
                         struct nearest *nearest)
{
    const float *word = codes->word + kind * (size_t)codes->tags * (size_t)codes->cells;
    int32_t begin;

    nearest->place = -1;
    nearest->sum = 0.0f;
    nearest->next = (float)(GREATEST_ERROR * GREATEST_ERROR) * (float)codes->cells;
    for (begin = 0; begin < codes->tags; begin += TOGETHER) {
        int32_t end = begin + TOGETHER < codes->tags ? begin + TOGETHER : codes->tags;

        compare(cells, codes->cells, word, codes->tags, begin, end, nearest);
    }
}

/* Sets what the nearest word says; tells whether it is sure, though others may be near. */
static int is_nearest(const struct vs_codes *codes, const float *cells, size_t kind,
                      const struct nearest *nearest, struct vs_marker *marker)
{
    size_t tags = (size_t)codes->tags;
    const float *word = codes->word + kind * tags * (size_t)codes->cells;
    double next = vs_root((double)nearest->next / codes->cells);

    marker->tag = marker->guess = -1.0;
    marker->error = marker->margin = GREATEST_ERROR;
    if (nearest->place < 0)
        return 0;
    marker->guess = codes->tag[nearest->place];
    marker->error = vs_root((double)nearest->sum / codes->cells);
    marker->margin = next / (marker->error > LEAST_ERROR ? marker->error : LEAST_ERROR);
    return marker->margin > LEAST_MARGIN &&
           marker->error < (double)codes->most_error[kind * tags + (size_t)nearest->place] &&
           is_alike(cells, codes->cells, word + nearest->place, codes->tags);
}

static void name(const struct vs_codes *codes, struct vs_marker *marker)
{
    int32_t ahead = vs_edges_level(codes->sharp, VS_CODES_BLURS, marker->sharp_ahead);
    int32_t left = vs_edges_level(codes->sharp, VS_CODES_BLURS, marker->sharp_left);
    size_t kind = (size_t)(ahead * VS_CODES_BLURS + left);
    double lost = 0.5 * (codes->lost[ahead] + codes->lost[left]);
    float cells[VS_OUTLINE_CELLS];
    struct nearest nearest;
    struct fitted fitted;
    int32_t i, place;
    int is_near;

    /* Cells are told between what was measured near to blurred edges, where black is not black. */
    for (i = 0; i < codes->cells; i++)
        cells[i] = (float)((1.0 - 2.0 * lost) * marker->cell[i] + lost);
    find_nearest(codes, cells, kind, &nearest);
    is_near = is_nearest(codes, cells, kind, &nearest, marker);
    if (is_near && marker->margin > PLAIN_MARGIN) {
        marker->tag = marker->guess;
        return;
    }
    place = name_fitted(codes, cells, ahead, left, &fitted);
    if (is_near) {
        if (fitted.place == nearest.place)
            marker->tag = marker->guess;
    } else if (place >= 0) {
        marker->tag = marker->guess = codes->tag[place];
        marker->error = fitted.error;
        marker->margin = fitted.margin;
    }
}

void vs_codes_name(const struct vs_codes *codes, struct vs_marker *markers, size_t count)
{
    size_t i;

    for (i = 0; i < count; i++)
        name(codes, &markers[i]);
}
