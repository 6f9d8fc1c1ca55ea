/* SPDX-License-Identifier: MIT */
#include "vs_scan.h"

#include <string.h>
#ifdef __SSE2__
#include <immintrin.h>
#endif

#include "vs_levels.h"

#define NO_PART UINT32_MAX

/* One bit for each of 16 pixels, the first the lowest: 1 where darker than level. */
#ifdef __SSE2__
static uint16_t dark_bits(const uint8_t *pixels, uint8_t level)
{
    __m128i grey = _mm_loadu_si128((const __m128i *)pixels);
    __m128i lighter = _mm_max_epu8(grey, _mm_set1_epi8((char)level));

    return (uint16_t)~_mm_movemask_epi8(_mm_cmpeq_epi8(grey, lighter));
}
#else
static uint64_t eight_bytes(const uint8_t *p)
{
    return (uint64_t)p[0] | (uint64_t)p[1] << 8 | (uint64_t)p[2] << 16 |
           (uint64_t)p[3] << 24 | (uint64_t)p[4] << 32 | (uint64_t)p[5] << 40 |
           (uint64_t)p[6] << 48 | (uint64_t)p[7] << 56;
}

static uint16_t dark_bits(const uint8_t *pixels, uint8_t level)
{
    const uint64_t gather = 0x0102040810204080U;
    uint8_t flag[VS_SCAN_BLOCK];
    uint64_t first, second;
    int i;

    for (i = 0; i < VS_SCAN_BLOCK; i++)
        flag[i] = pixels[i] < level;
    first = eight_bytes(flag);
    second = eight_bytes(flag + 8);
    return (uint16_t)(first * gather >> 56 | second * gather >> 56 << 8);
}
#endif

/* The place of the lowest 1 in a word that is not 0, by a de Bruijn sequence. */
static unsigned lowest(uint32_t word)
{
    static const uint8_t place[32] = {
        0, 1, 28, 2, 29, 14, 24, 3, 30, 22, 20, 15, 25, 17, 4, 8,
        31, 27, 13, 23, 21, 19, 16, 7, 26, 12, 18, 6, 11, 5, 10, 9
    };

    return place[(word & (0U - word)) * 0x077CB531U >> 27];
}

/*
 * Appends the runs of a row of 16-pixel words; a dark pixel that stands alone is
 * noise. Returns 0 where the table is full.
 */
static int add_runs(struct vs_scan *s, const uint16_t *words, uint32_t count)
{
    static const uint16_t empty[4] = {0, 0, 0, 0};
    struct vs_run *const runs = s->runs;
    const uint32_t room = s->run_room;
    uint32_t before = 0, run = s->run_count;
    uint32_t i;

    for (i = 0; i < count; i++) {
        uint32_t word = words[i], edges;

        if (word == 0 && before == 0) {
            while (i + 5 <= count && memcmp(&words[i + 1], empty, sizeof empty) == 0)
                i += 4;
            continue;
        }
        edges = word ^ (word << 1 | before);
        before = word >> 15;
        for (edges &= 0xFFFF; edges != 0; edges &= edges - 1) {
            uint32_t x = i * VS_SCAN_BLOCK + lowest(edges);

            if ((word >> lowest(edges) & 1) != 0) {
                if (run + 1 >= room)
                    return 0;
                runs[run].begin = (uint16_t)x;
            } else {
                runs[run].end = (uint16_t)x;
                run += x - runs[run].begin > 1;
            }
        }
    }
    s->run_count = run;
    return 1;
}

uint32_t vs_scan_root(struct vs_scan *s, uint32_t part)
{
    struct vs_part *const parts = s->parts;

    while (parts[part].parent != part) {
        parts[part].parent = parts[parts[part].parent].parent;
        part = parts[part].parent;
    }
    return part;
}

/* Joins two parts; the older speaks for both. */
static uint32_t join(struct vs_scan *s, uint32_t one, uint32_t other)
{
    struct vs_part *to, *from;

    if (one == other)
        return one;
    if (other < one) {
        uint32_t swap = one;

        one = other;
        other = swap;
    }
    to = &s->parts[one];
    from = &s->parts[other];
    from->parent = one;
    to->dark_px += from->dark_px;
    to->left = from->left < to->left ? from->left : to->left;
    to->right = from->right > to->right ? from->right : to->right;
    to->top = from->top < to->top ? from->top : to->top;
    to->bottom = from->bottom > to->bottom ? from->bottom : to->bottom;
    return one;
}

static void begin_part(struct vs_scan *s, struct vs_run *run, uint32_t row)
{
    struct vs_part *part = &s->parts[s->part_count];

    part->parent = s->part_count;
    part->dark_px = (uint32_t)(run->end - run->begin);
    part->left = run->begin;
    part->right = run->end;
    part->top = part->bottom = (uint16_t)row;
    run->part = s->part_count++;
}

static void extend_part(struct vs_part *part, const struct vs_run *run, uint32_t row)
{
    part->dark_px += (uint32_t)(run->end - run->begin);
    part->left = run->begin < part->left ? run->begin : part->left;
    part->right = run->end > part->right ? run->end : part->right;
    part->bottom = (uint16_t)row;
}

/* Gives each run of a row to a part; runs of neighbouring rows touch at corners, too. */
static int link_row(struct vs_scan *s, uint32_t row)
{
    struct vs_run *const runs = s->runs;
    const uint32_t end = s->first[row], count = s->run_count;
    uint32_t above = row > 0 ? s->first[row - 1] : 0;
    uint32_t i;

    for (i = end; i < count; i++) {
        struct vs_run *run = &runs[i];
        uint32_t part = NO_PART;
        uint32_t k;

        while (above < end && runs[above].end < run->begin)
            above++;
        for (k = above; k < end && runs[k].begin <= run->end; k++) {
            uint32_t root = vs_scan_root(s, runs[k].part);

            part = part == NO_PART ? root : join(s, part, root);
        }
        if (part != NO_PART) {
            extend_part(&s->parts[part], run, row);
            run->part = part;
        } else if (s->part_count < s->part_room) {
            begin_part(s, run, row);
        } else {
            return 0;
        }
    }
    return 1;
}

/*
 * Thresholds a line of blocks into words of 16 pixels, for each scanned row one word
 * per block and one that is empty.
 */
static void threshold_line(struct vs_scan *s, const struct vs_picture *p, uint32_t line)
{
    const uint8_t *level = s->level + line * s->line;
    int top = (int)line * VS_SCAN_BLOCK;
    int rows = (p->height_px - top + VS_SCAN_STEP - 1) / VS_SCAN_STEP;
    uint32_t i;
    int k;

    rows = rows > VS_SCAN_BLOCK / VS_SCAN_STEP ? VS_SCAN_BLOCK / VS_SCAN_STEP : rows;
    for (k = 0; k < rows; k++)
        memset(s->words[k], 0, (s->line + 1) * sizeof s->words[k][0]);
    for (i = 0; i < s->line; i++) {
        int columns = p->width_px - (int)i * VS_SCAN_BLOCK;
        const uint8_t *pixels = p->pixels + (size_t)top * p->stride + i * VS_SCAN_BLOCK;
        uint8_t rest[VS_SCAN_BLOCK];

        if (level[i] == 0)
            continue;
        for (k = 0; k < rows; k++, pixels += VS_SCAN_STEP * p->stride) {
            if (columns >= VS_SCAN_BLOCK) {
                s->words[k][i] = dark_bits(pixels, level[i]);
            } else {
                memset(rest, 255, sizeof rest);
                memcpy(rest, pixels, (size_t)columns);
                s->words[k][i] = dark_bits(rest, level[i]);
            }
        }
    }
}

/* Finds and links the runs of all rows, as far as the tables reach. */
static void link_rows(struct vs_scan *s, const struct vs_picture *p)
{
    uint32_t row;

    for (row = 0; row < s->rows; row++) {
        uint32_t within = row % (VS_SCAN_BLOCK / VS_SCAN_STEP);

        if (within == 0)
            threshold_line(s, p, row / (VS_SCAN_BLOCK / VS_SCAN_STEP));
        s->first[row] = s->run_count;
        if (!add_runs(s, s->words[within], s->line + 1))
            s->full |= VS_MARKERS_FULL_RUNS;
        else if (!link_row(s, row))
            s->full |= VS_MARKERS_FULL_PARTS;
        if (s->full != 0)
            break;
    }
    if (row < s->rows)
        s->run_count = s->first[row];
    s->rows = row;
    s->first[row] = s->run_count;
}

void vs_scan_again(struct vs_scan *s, const struct vs_picture *picture,
                   const struct vs_search *search, int32_t level_256)
{
    s->full = s->run_count = s->part_count = 0;
    s->rows = ((uint32_t)picture->height_px + VS_SCAN_STEP - 1) / VS_SCAN_STEP;
    vs_levels_set(s, search, level_256);
    link_rows(s, picture);
}

int vs_scan_picture(struct vs_scan *s, const struct vs_picture *picture,
                    const struct vs_search *search)
{
    int32_t width = picture->width_px, height = picture->height_px;

    s->full = s->rows = s->run_count = s->part_count = 0;
    if (width < 1 || width > VS_SCAN_SIDE || height < 1 || height > VS_SCAN_SIDE ||
        picture->stride < (size_t)width || search->level_256 < 1 || search->level_256 > 255 ||
        search->print_256 < 0 || search->print_256 > 256)
        return VS_ERR_ARGUMENT;
    s->line = ((uint32_t)width + VS_SCAN_BLOCK - 1) / VS_SCAN_BLOCK;
    s->lines = ((uint32_t)height + VS_SCAN_BLOCK - 1) / VS_SCAN_BLOCK;
    vs_levels_measure(s, picture);
    vs_scan_again(s, picture, search, search->level_256);
    return VS_OK;
}
