/* SPDX-License-Identifier: MIT */
#include "vs_scan.h"

#include <string.h>

#define PRINT_256 102  /* [1/256] of the light ground: ink is at least so much darker */
#define NOISE_SHARE 13 /* [1/8] of the usual block's range is what noise alone makes */
#define FLOOR_BLOCKS 256 /* fewer blocks may all be markers */
#define NOISE_MOST 72  /* [grey] the most that noise can raise the contrast asked for */

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

static void find_extremes(struct vs_scan *s, const struct vs_picture *p)
{
    uint32_t line, column;

    for (line = 0; line < s->lines; line++) {
        int top = (int)line * VS_SCAN_BLOCK;
        int rows = p->height_px - top < VS_SCAN_BLOCK ? p->height_px - top : VS_SCAN_BLOCK;
        const uint8_t *pixels = p->pixels + (size_t)top * p->stride;
        uint8_t *dark = s->dark + line * s->line;
        uint8_t *light = s->light + line * s->line;

        for (column = 0; column < s->line; column++, pixels += VS_SCAN_BLOCK) {
            int columns = p->width_px - (int)column * VS_SCAN_BLOCK;

            if (columns >= VS_SCAN_BLOCK)
                block_extremes(pixels, p->stride, rows, &dark[column], &light[column]);
            else
                edge_extremes(pixels, p->stride, rows, columns, &dark[column],
                              &light[column]);
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

/* The level between the extremes of a neighbourhood; 0 where nothing is printed. */
static uint8_t level_between(int low, int high, int contrast, int level_256)
{
    if (high - low < contrast || (high - low) * 256 < high * PRINT_256)
        return 0;
    return (uint8_t)(low + ((high - low) * level_256 + 128) / 256);
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

/* Sets each block's level from the extremes of the 3 x 3 blocks around it. */
static void find_levels(struct vs_scan *s, int contrast, int level_256)
{
    uint8_t dark[VS_SCAN_LINE + 2], light[VS_SCAN_LINE + 2];
    uint32_t line, i;

    for (line = 0; line < s->lines; line++) {
        uint8_t *level = s->level + line * s->line;

        fold_columns(s, line, dark, light);
        for (i = 0; i < s->line; i++) {
            int low = dark[i] < dark[i + 1] ? dark[i] : dark[i + 1];
            int high = light[i] > light[i + 1] ? light[i] : light[i + 1];

            low = dark[i + 2] < low ? dark[i + 2] : low;
            high = light[i + 2] > high ? light[i + 2] : high;
            level[i] = level_between(low, high, contrast, level_256);
        }
    }
}

static uint64_t eight_bytes(const uint8_t *p)
{
    return (uint64_t)p[0] | (uint64_t)p[1] << 8 | (uint64_t)p[2] << 16 |
           (uint64_t)p[3] << 24 | (uint64_t)p[4] << 32 | (uint64_t)p[5] << 40 |
           (uint64_t)p[6] << 48 | (uint64_t)p[7] << 56;
}

/* One bit for each of 16 pixels, the first the lowest: 1 where darker than level. */
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
    if ((first | second) == 0)
        return 0;
    return (uint16_t)(first * gather >> 56 | second * gather >> 56 << 8);
}

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
                if (run + 1 >= VS_SCAN_RUNS)
                    return 0;
                s->runs[run].begin = (uint16_t)x;
            } else {
                s->runs[run].end = (uint16_t)x;
                run += x - s->runs[run].begin > 1;
            }
        }
    }
    s->run_count = run;
    return 1;
}

uint32_t vs_scan_root(struct vs_scan *s, uint32_t part)
{
    while (s->parts[part].parent != part) {
        s->parts[part].parent = s->parts[s->parts[part].parent].parent;
        part = s->parts[part].parent;
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
    uint32_t above = row > 0 ? s->first[row - 1] : 0;
    uint32_t end = s->first[row];
    uint32_t i;

    for (i = end; i < s->run_count; i++) {
        struct vs_run *run = &s->runs[i];
        uint32_t part = VS_SCAN_PARTS;
        uint32_t k;

        while (above < end && s->runs[above].end < run->begin)
            above++;
        for (k = above; k < end && s->runs[k].begin <= run->end; k++) {
            uint32_t root = vs_scan_root(s, s->runs[k].part);

            part = part == VS_SCAN_PARTS ? root : join(s, part, root);
        }
        if (part != VS_SCAN_PARTS) {
            extend_part(&s->parts[part], run, row);
            run->part = part;
        } else if (s->part_count < VS_SCAN_PARTS) {
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

int vs_scan_picture(struct vs_scan *s, const struct vs_picture *picture,
                    int32_t least_contrast, int32_t level_256)
{
    int32_t width = picture->width_px, height = picture->height_px;

    s->full = s->rows = s->run_count = s->part_count = 0;
    if (width < 1 || width > VS_SCAN_SIDE || height < 1 || height > VS_SCAN_SIDE ||
        picture->stride < (size_t)width || level_256 < 1 || level_256 > 255)
        return VS_ERR_ARGUMENT;
    s->line = ((uint32_t)width + VS_SCAN_BLOCK - 1) / VS_SCAN_BLOCK;
    s->lines = ((uint32_t)height + VS_SCAN_BLOCK - 1) / VS_SCAN_BLOCK;
    s->rows = ((uint32_t)height + VS_SCAN_STEP - 1) / VS_SCAN_STEP;
    find_extremes(s, picture);
    find_levels(s, needed_contrast(s, least_contrast), level_256);
    link_rows(s, picture);
    return VS_OK;
}
