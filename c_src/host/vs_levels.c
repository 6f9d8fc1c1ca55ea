/* SPDX-License-Identifier: MIT */
#include "vs_levels.h"

#include <string.h>
#ifdef __SSE2__
#include <immintrin.h>
#endif

#define NOISE_SHARE 13   /* [1/8] of the usual block's range is what noise alone makes */
#define VEIL_BLOCKS 256  /* one in so many may be darker than the veil over the picture */
#define FLOOR_BLOCKS 256 /* fewer blocks may all be markers */
#define NOISE_MOST 72    /* [grey] the most that noise can raise the contrast asked for */

static void fold_low(uint8_t *low, const uint8_t *row)
{
    int x;

    for (x = 0; x < VS_SCAN_BLOCK; x++)
        low[x] = row[x] < low[x] ? row[x] : low[x];
}

static void fold_high(uint8_t *high, const uint8_t *row)
{
    int x;

    for (x = 0; x < VS_SCAN_BLOCK; x++)
        high[x] = row[x] > high[x] ? row[x] : high[x];
}

/*
 * Writes the extremes of a block 16 pixels wide, every second row. Loops of a fixed
 * length over bytes are single instructions to a compiler that makes vectors.
 */
static void block_extremes(const uint8_t *pixels, size_t stride, int rows,
                           uint8_t *dark, uint8_t *light)
{
    uint8_t low[VS_SCAN_BLOCK], high[VS_SCAN_BLOCK];
    uint8_t lowest_grey = 255, highest_grey = 0;
    int x, y;

    memcpy(low, pixels, sizeof low);
    memcpy(high, pixels, sizeof high);
    for (y = VS_SCAN_STEP; y < rows; y += VS_SCAN_STEP) {
        fold_low(low, pixels + (size_t)y * stride);
        fold_high(high, pixels + (size_t)y * stride);
    }
    for (x = 0; x < VS_SCAN_BLOCK; x++)
        lowest_grey = low[x] < lowest_grey ? low[x] : lowest_grey;
    for (x = 0; x < VS_SCAN_BLOCK; x++)
        highest_grey = high[x] > highest_grey ? high[x] : highest_grey;
    *dark = lowest_grey;
    *light = highest_grey;
}

/* The same for a block that reaches over the picture's right border. */
static void edge_extremes(const uint8_t *pixels, size_t stride, int rows, int columns,
                          uint8_t *dark, uint8_t *light)
{
    int x, y;

    *dark = *light = pixels[0];
    for (y = 0; y < rows; y += VS_SCAN_STEP) {
        const uint8_t *row = pixels + (size_t)y * stride;

        for (x = 0; x < columns; x++) {
            *dark = row[x] < *dark ? row[x] : *dark;
            *light = row[x] > *light ? row[x] : *light;
        }
    }
}

#ifdef __SSE2__
#define TOGETHER 16 /* blocks whose extremes are one vector */

/* Puts the extremes of two halves of both vectors beside each other, by bytes of size. */
#define HALVED(fold, size, a, b)                                                              \
    fold(_mm_unpacklo_epi##size(a, b), _mm_unpackhi_epi##size(a, b))

/* The extremes of 16 vectors' bytes, one byte for each: a tree of 15 pairs. */
#define EXTREMES(fold, v)                                                                     \
    do {                                                                                      \
        int i;                                                                                \
                                                                                              \
        for (i = 0; i < 8; i++)                                                               \
            v[i] = HALVED(fold, 8, v[i], v[i + 8]);                                           \
        for (i = 0; i < 4; i++)                                                               \
            v[i] = HALVED(fold, 8, v[i], v[i + 4]);                                           \
        for (i = 0; i < 2; i++)                                                               \
            v[i] = HALVED(fold, 8, v[i], v[i + 2]);                                           \
        v[0] = HALVED(fold, 8, v[0], v[1]);                                                   \
    } while (0)

/* Writes the extremes of 16 blocks side by side, every second row. */
static void extremes_together(const uint8_t *pixels, size_t stride, int rows, uint8_t *dark,
                              uint8_t *light)
{
    __m128i low[TOGETHER], high[TOGETHER];
    int block, y;

    for (block = 0; block < TOGETHER; block++, pixels += VS_SCAN_BLOCK) {
        __m128i l = _mm_loadu_si128((const __m128i *)pixels), h = l;

        for (y = VS_SCAN_STEP; y < rows; y += VS_SCAN_STEP) {
            __m128i row = _mm_loadu_si128((const __m128i *)(pixels + (size_t)y * stride));

            l = _mm_min_epu8(l, row);
            h = _mm_max_epu8(h, row);
        }
        low[block] = l;
        high[block] = h;
    }
    EXTREMES(_mm_min_epu8, low);
    EXTREMES(_mm_max_epu8, high);
    _mm_storeu_si128((__m128i *)dark, low[0]);
    _mm_storeu_si128((__m128i *)light, high[0]);
}
#endif

void vs_levels_measure(struct vs_scan *s, const struct vs_picture *p)
{
    uint32_t line, column;

    for (line = 0; line < s->lines; line++) {
        int top = (int)line * VS_SCAN_BLOCK;
        int rows = p->height_px - top < VS_SCAN_BLOCK ? p->height_px - top : VS_SCAN_BLOCK;
        const uint8_t *pixels = p->pixels + (size_t)top * p->stride;
        uint8_t *dark = s->dark + line * s->line;
        uint8_t *light = s->light + line * s->line;

        column = 0;
#ifdef __SSE2__
        for (; (column + TOGETHER) * VS_SCAN_BLOCK <= (uint32_t)p->width_px; column += TOGETHER)
            extremes_together(pixels + column * VS_SCAN_BLOCK, p->stride, rows, &dark[column],
                              &light[column]);
#endif
        for (; column < s->line; column++) {
            int columns = p->width_px - (int)column * VS_SCAN_BLOCK;

            const uint8_t *block = pixels + column * VS_SCAN_BLOCK;

            if (columns >= VS_SCAN_BLOCK)
                block_extremes(block, p->stride, rows, &dark[column], &light[column]);
            else
                edge_extremes(block, p->stride, rows, columns, &dark[column], &light[column]);
        }
    }
}

/*
 * The contrast to ask for: most blocks of a whole picture are plain floor, so their
 * range is the noise's. A small window around a marker says nothing about the floor.
 */
static int needed_contrast(const struct vs_scan *s, int least)
{
    uint32_t count = s->line * s->lines;
    uint32_t histogram[256];
    uint32_t i, below = 0;
    int needed;

    if (count < FLOOR_BLOCKS)
        return least;
    memset(histogram, 0, sizeof histogram);
    for (i = 0; i < count; i++)
        histogram[s->light[i] - s->dark[i]]++;
    for (i = 0; i < 255 && (below += histogram[i]) <= count / 2; i++)
        ;
    needed = (int)i * NOISE_SHARE / 8;
    needed = needed > NOISE_MOST ? NOISE_MOST : needed;
    return needed > least ? needed : least;
}

/* What lies over the whole picture, such as scattered light: nothing in it is darker. */
static int veil_over(const struct vs_scan *s)
{
    uint32_t count = s->line * s->lines;
    uint32_t histogram[256];
    uint32_t i, below = 0;

    memset(histogram, 0, sizeof histogram);
    for (i = 0; i < count; i++)
        histogram[s->dark[i]]++;
    for (i = 0; i < 255 && (below += histogram[i]) <= count / VEIL_BLOCKS; i++)
        ;
    return (int)i;
}

/* Where a neighbourhood is printed, and the level between its extremes. */
struct rule {
    int contrast;
    int level_256;
    int print_256;
    int veil;
};

/* The level between the extremes of a neighbourhood; 0 where nothing is printed. */
static uint8_t level_between(int low, int high, const struct rule *rule)
{
    if (high - low < rule->contrast || (high - low) * 256 < (high - rule->veil) * rule->print_256)
        return 0;
    return (uint8_t)(low + ((high - low) * rule->level_256 + 128) / 256);
}

/* Writes the extremes of each three blocks in a column, from place 1 on. */
static void fold_columns(const struct vs_scan *s, uint32_t line, uint8_t *dark, uint8_t *light)
{
    uint32_t n = s->line, here = line * n;
    uint32_t above = line > 0 ? here - n : here;
    uint32_t below = line + 1 < s->lines ? here + n : here;
    uint32_t i;

    for (i = 0; i < n; i++) {
        uint8_t a = s->dark[above + i], b = s->dark[here + i], c = s->dark[below + i];

        b = a < b ? a : b;
        dark[i + 1] = c < b ? c : b;
        a = s->light[above + i];
        b = s->light[here + i];
        c = s->light[below + i];
        b = a > b ? a : b;
        light[i + 1] = c > b ? c : b;
    }
    dark[0] = dark[1];
    light[0] = light[1];
    dark[n + 1] = dark[n];
    light[n + 1] = light[n];
}

void vs_levels_set(struct vs_scan *s, const struct vs_search *search, int32_t level_256)
{
    struct rule rule;
    uint8_t dark[VS_SCAN_LINE + 2], light[VS_SCAN_LINE + 2];
    uint32_t line, i;

    rule.contrast = needed_contrast(s, search->least_contrast);
    rule.level_256 = level_256;
    rule.print_256 = search->print_256;
    rule.veil = search->has_veil ? veil_over(s) : 0;
    for (line = 0; line < s->lines; line++) {
        uint8_t *level = s->level + line * s->line;

        fold_columns(s, line, dark, light);
        for (i = 0; i < s->line; i++) {
            int low = dark[i] < dark[i + 1] ? dark[i] : dark[i + 1];
            int high = light[i] > light[i + 1] ? light[i] : light[i + 1];

            low = dark[i + 2] < low ? dark[i + 2] : low;
            high = light[i + 2] > high ? light[i + 2] : high;
            level[i] = level_between(low, high, &rule);
        }
    }
}
