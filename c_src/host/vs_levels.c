/* SPDX-License-Identifier: MIT */
#include "vs_levels.h"

#include <string.h>
#ifdef __SSE2__
#include <immintrin.h>
#endif

#define NOISE_SHARE 13   /* [1/8] of the usual block's range is what noise alone makes */
#define VEIL_BLOCKS 256  /* one in so many may be darker than the veil over the picture */
#define FLOOR_BLOCKS 256 /* fewer blocks may all be markers */
#define BESIDE 16        /* blocks that are worked on at once: loops of a fixed length are vectors */
#define NOISE_MOST 72    /* [grey] the most that noise can raise the contrast asked for */
#define PALE_BLOCKS 1024 /* one in so many may have more contrast than a pale picture */
#define PALE 2           /* times the contrast asked for: the most in a pale picture */

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

/* The first value that more than so many are not above. */
static int quantile(const uint32_t histogram[256], uint32_t most)
{
    uint32_t below = 0;
    int i;

    for (i = 0; i < 255 && (below += histogram[i]) <= most; i++)
        ;
    return i;
}

/*
 * What lies over the whole picture. Most of its blocks are plain floor, so their range is the
 * noise's; a small window around a marker says nothing about the floor. Scattered light is a
 * veil: nothing in the picture is darker. Where nothing has much contrast the picture is pale.
 */
static void measure_whole(struct vs_scan *s)
{
    uint32_t range[256], dark[256], count = s->line * s->lines, i;

    memset(range, 0, sizeof range);
    memset(dark, 0, sizeof dark);
    for (i = 0; i < count; i++) {
        range[s->light[i] - s->dark[i]]++;
        dark[s->dark[i]]++;
    }
    s->noise = count < FLOOR_BLOCKS ? 0 : quantile(range, count / 2) * NOISE_SHARE / 8;
    s->noise = s->noise > NOISE_MOST ? NOISE_MOST : s->noise;
    s->veil = quantile(dark, count / VEIL_BLOCKS);
    s->contrast = quantile(range, count - 1 - count / PALE_BLOCKS);
}

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
    measure_whole(s);
}

/* Where a neighbourhood is printed, and the level between its extremes. */
struct rule {
    uint16_t contrast;
    uint16_t level_256;
    uint16_t print_256;
    uint16_t veil;
};

static uint16_t asked(int32_t value)
{
    return (uint16_t)(value < 0 ? 0 : value > 256 ? 256 : value);
}

static void least_of(const uint8_t *a, const uint8_t *b, const uint8_t *c, uint8_t *least)
{
    int i;

    for (i = 0; i < BESIDE; i++) {
        uint8_t low = a[i] < b[i] ? a[i] : b[i];

        least[i] = c[i] < low ? c[i] : low;
    }
}

static void most_of(const uint8_t *a, const uint8_t *b, const uint8_t *c, uint8_t *most)
{
    int i;

    for (i = 0; i < BESIDE; i++) {
        uint8_t high = a[i] > b[i] ? a[i] : b[i];

        most[i] = c[i] > high ? c[i] : high;
    }
}

/* The levels between the extremes of neighbourhoods; 0 where nothing is printed. */
static void levels_between(const uint8_t *low, const uint8_t *high, const struct rule *rule,
                           uint8_t *level)
{
    const struct rule r = *rule;
    int i;

    for (i = 0; i < BESIDE; i++) {
        uint16_t range = (uint16_t)(high[i] - low[i]);
        uint16_t light = high[i] > r.veil ? (uint16_t)(high[i] - r.veil) : 0;
        uint16_t least = (uint16_t)(light * r.print_256); /* at most 255 * 256 */
        uint16_t share = (uint16_t)((uint16_t)(range * r.level_256 + 128) >> 8);
        uint16_t plain = (range < r.contrast) | ((uint16_t)(range << 8) < least);

        level[i] = plain != 0 ? 0 : (uint8_t)(low[i] + share);
    }
}

/* Writes the extremes of each three blocks in a column, from place 1 on. */
static void fold_columns(const struct vs_scan *s, uint32_t line, uint8_t *dark, uint8_t *light)
{
    uint32_t n = s->line, here = line * n, i;
    uint32_t above = line > 0 ? here - n : here;
    uint32_t below = line + 1 < s->lines ? here + n : here;

    for (i = 0; i < n; i += BESIDE) {
        least_of(&s->dark[above + i], &s->dark[here + i], &s->dark[below + i], &dark[i + 1]);
        most_of(&s->light[above + i], &s->light[here + i], &s->light[below + i],
                &light[i + 1]);
    }
    dark[0] = dark[1];
    light[0] = light[1];
    dark[n + 1] = dark[n];
    light[n + 1] = light[n];
}

int vs_levels_reach(const struct vs_scan *s, int32_t light)
{
    uint32_t count = s->line * s->lines, i;
    uint8_t most[VS_SCAN_BLOCK] = {0};

    for (i = 0; i + VS_SCAN_BLOCK <= count; i += VS_SCAN_BLOCK)
        fold_high(most, s->light + i);
    for (; i < count; i++)
        most[0] = s->light[i] > most[0] ? s->light[i] : most[0];
    for (i = 1; i < VS_SCAN_BLOCK; i++)
        most[0] = most[i] > most[0] ? most[i] : most[0];
    return most[0] >= light;
}

static struct rule make_rule(struct vs_scan *s, const struct vs_search *search, int32_t level_256)
{
    int32_t contrast = search->least_contrast;
    struct rule rule;

    s->pale = search->pale_contrast > 0 && s->contrast < PALE * contrast;
    contrast = s->pale ? search->pale_contrast : contrast;
    rule.contrast = asked(contrast > s->noise ? contrast : s->noise);
    rule.level_256 = asked(level_256);
    rule.print_256 = asked(search->print_256);
    rule.veil = asked(s->pale || search->has_veil ? s->veil : 0);
    return rule;
}

/* Takes away the levels of what is not beside something as light. */
static void keep_beside(const uint8_t *high, int32_t least_light, uint8_t *level)
{
    int i;

    for (i = 0; i < BESIDE; i++)
        level[i] = high[i] < least_light ? 0 : level[i];
}

void vs_levels_set(struct vs_scan *s, const struct vs_search *search, int32_t level_256,
                   int32_t least_light)
{
    const struct rule rule = make_rule(s, search, level_256);
    uint8_t dark[VS_SCAN_LINE + 2 + BESIDE], light[VS_SCAN_LINE + 2 + BESIDE];
    uint8_t low[BESIDE], high[BESIDE];
    uint32_t line, i;

    memset(dark, 0, sizeof dark);
    memset(light, 0, sizeof light);
    for (line = 0; line < s->lines; line++) {
        fold_columns(s, line, dark, light);
        for (i = 0; i < s->line; i += BESIDE) {
            least_of(&dark[i], &dark[i + 1], &dark[i + 2], low);
            most_of(&light[i], &light[i + 1], &light[i + 2], high);
            levels_between(low, high, &rule, &s->level[line * s->line + i]);
            if (least_light > 0)
                keep_beside(high, least_light, &s->level[line * s->line + i]);
        }
    }
}
