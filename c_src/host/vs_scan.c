/* SPDX-License-Identifier: MIT */
#include "vs_scan.h"

#include <string.h>
#ifdef __SSE2__
#include <immintrin.h>
#endif

#include "vs_levels.h"
#include "vs_math.h"

#define NO_PART UINT32_MAX
#define FOUR 4 /* words of a row that are looked at at once */

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
static unsigned lowest(uint64_t word)
{
    static const uint8_t place[64] = {
        0,  1,  48, 2,  57, 49, 28, 3,  61, 58, 50, 42, 38, 29, 17, 4,
        62, 55, 59, 36, 53, 51, 43, 22, 45, 39, 33, 30, 24, 18, 12, 5,
        63, 47, 56, 27, 60, 41, 37, 16, 54, 35, 52, 21, 44, 32, 23, 11,
        46, 26, 40, 15, 34, 20, 31, 10, 25, 14, 19, 9,  13, 8,  7,  6
    };

    return place[(word & (0U - word)) * 0x03F79D71B4CB0A89U >> 58];
}

/* Writes where a row of count words changes from light to dark and back; returns how often. */
static uint32_t find_edges(const uint16_t *words, uint32_t count, uint16_t *edge)
{
    uint64_t before = 0;
    uint32_t i, found = 0;

    for (i = 0; i < count; i += FOUR) {
        uint64_t word = (uint64_t)words[i] | (uint64_t)words[i + 1] << 16 |
                        (uint64_t)words[i + 2] << 32 | (uint64_t)words[i + 3] << 48;
        uint64_t edges = word ^ (word << 1 | before);

        before = word >> 63;
        for (; edges != 0; edges &= edges - 1)
            edge[found++] = (uint16_t)(i * VS_SCAN_BLOCK + lowest(edges));
    }
    return found;
}

/*
 * Appends the runs of a row of words; a dark pixel that stands alone is noise. Returns 0 where
 * the table is full.
 */
static int add_runs(struct vs_scan *s, const uint16_t *words, uint32_t count)
{
    struct vs_run *const runs = s->runs;
    const uint16_t *const edge = s->edge;
    uint32_t edges = find_edges(words, count, s->edge), run = s->run_count, i;

    for (i = 0; i < edges; i += 2) {
        if (run + 1 >= s->run_room)
            return 0;
        runs[run].begin = edge[i];
        runs[run].end = edge[i + 1];
        run += edge[i + 1] - edge[i] > 1;
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
        memset(s->words[k], 0, (s->line + FOUR) * sizeof s->words[k][0]);
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

/* Clears a row's pixels begin .. end - 1. */
static void clear_pixels(uint16_t *words, uint32_t begin, uint32_t end)
{
    uint32_t first = begin / VS_SCAN_BLOCK, last = end / VS_SCAN_BLOCK, i;
    uint32_t before = (1U << begin % VS_SCAN_BLOCK) - 1U;
    uint32_t behind = ~((1U << end % VS_SCAN_BLOCK) - 1U);

    if (first == last) {
        words[first] &= (uint16_t)(before | behind);
        return;
    }
    words[first] &= (uint16_t)before;
    for (i = first + 1; i < last; i++)
        words[i] = 0;
    words[last] &= (uint16_t)behind;
}

/* Clears what a line of blocks shows of a disc. */
static void clear_disc(struct vs_scan *s, const struct vs_picture *p, uint32_t line,
                       const struct vs_spot *disc)
{
    int top = (int)line * VS_SCAN_BLOCK, k;

    if (!(disc->y_px + disc->radius_px > top &&
          disc->y_px - disc->radius_px < top + VS_SCAN_BLOCK))
        return;
    for (k = 0; k < VS_SCAN_BLOCK / VS_SCAN_STEP; k++) {
        double down = top + k * VS_SCAN_STEP - disc->y_px;
        double half = disc->radius_px * disc->radius_px - down * down;
        double begin, end;

        if (half <= 0.0)
            continue;
        half = vs_root(half);
        begin = vs_most(disc->x_px - half, 0.0);
        end = vs_least(disc->x_px + half, p->width_px);
        if (begin < end)
            clear_pixels(s->words[k], (uint32_t)begin, (uint32_t)end);
    }
}

/* Finds and links the runs of all rows, as far as the tables reach. */
static void link_rows(struct vs_scan *s, const struct vs_picture *p,
                      const struct vs_spot *without, size_t count)
{
    uint32_t row;
    size_t i;

    for (row = 0; row < s->rows; row++) {
        uint32_t within = row % (VS_SCAN_BLOCK / VS_SCAN_STEP);

        if (within == 0) {
            uint32_t line = row / (VS_SCAN_BLOCK / VS_SCAN_STEP);

            threshold_line(s, p, line);
            for (i = 0; i < count; i++)
                clear_disc(s, p, line, &without[i]);
        }
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

/* Nothing is dark in blocks that are to be skipped. */
static void skip_blocks(struct vs_scan *s, const uint8_t *outside)
{
    uint32_t count = s->line * s->lines, i;

    for (i = 0; i < count; i++)
        s->level[i] = outside[i] != 0 ? 0 : s->level[i];
}

int vs_scan_needs(const struct vs_scan *s, const struct vs_rescan *again)
{
    return again->level_256 > 0 && vs_levels_reach(s, again->least_light);
}

void vs_scan_again(struct vs_scan *s, const struct vs_picture *picture,
                   const struct vs_search *search, const struct vs_rescan *again,
                   const struct vs_spot *without, size_t count)
{
    s->full = s->run_count = s->part_count = 0;
    s->rows = ((uint32_t)picture->height_px + VS_SCAN_STEP - 1) / VS_SCAN_STEP;
    vs_levels_set(s, search, again->level_256, again->least_light);
    if (search->outside != NULL)
        skip_blocks(s, search->outside);
    link_rows(s, picture, without, count);
}

int vs_scan_picture(struct vs_scan *s, const struct vs_picture *picture,
                    const struct vs_search *search)
{
    int32_t width = picture->width_px, height = picture->height_px;
    struct vs_rescan first = {0, 0};

    s->full = s->rows = s->run_count = s->part_count = 0;
    if (width < 1 || width > VS_SCAN_SIDE || height < 1 || height > VS_SCAN_SIDE ||
        picture->stride < (size_t)width || search->level_256 < 1 || search->level_256 > 255 ||
        search->print_256 < 0 || search->print_256 > 256)
        return VS_ERR_ARGUMENT;
    s->line = ((uint32_t)width + VS_SCAN_BLOCK - 1) / VS_SCAN_BLOCK;
    s->lines = ((uint32_t)height + VS_SCAN_BLOCK - 1) / VS_SCAN_BLOCK;
    vs_levels_measure(s, picture);
    first.level_256 = search->level_256;
    vs_scan_again(s, picture, search, &first, NULL, 0);
    return VS_OK;
}
