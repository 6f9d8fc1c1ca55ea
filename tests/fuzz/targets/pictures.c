/* SPDX-License-Identifier: MIT */
/*
 * The picture kernel: pictures of any size and stride, lenses, outlines, words and codes of any
 * numbers, windows anywhere. It refuses, or what it finds lies in the picture and is made of numbers.
 */
#include "../../../c_src/host/vs_codes.h"
#include "../../../c_src/host/vs_markers.h"
#include "../../../c_src/host/vs_scan.h"
#include "../../../c_src/host/vs_words.h"
#include "fuzz.h"

#include <math.h>
#include <stdlib.h>

#define PIXELS 16384
#define FOUND 8
#define TAGS 5

static uint8_t pixels[PIXELS];
static struct vs_outline outline;
static struct vs_words words;
static struct vs_codes codes;
static struct vs_marker found[FOUND];
static uint32_t origin[FOUND];
static uint64_t *memory;

/* Mostly a number as it should be. */
static double number(struct input *in, double usual)
{
    uint8_t how = take_u8(in);

    if (how >= 252)
        return take_double(in);
    return usual * (1.0 + ((how & 15) - 4) / 16.0);
}

static void take_picture(struct input *in, struct vs_picture *picture)
{
    uint32_t seed = 1u + take_u16(in);
    uint8_t dark = take_u8(in);
    uint8_t light = take_u8(in);
    size_t side = 1u + take_u8(in);
    size_t i;

    picture->width_px = (int16_t)take_u16(in) % 400;
    picture->height_px = (int16_t)take_u16(in) % 400;
    picture->stride = take_u8(in) & 3 ? (size_t)abs(picture->width_px) : take_u16(in);
    if (picture->height_px > 0 && picture->stride * (size_t)picture->height_px > PIXELS)
        picture->height_px = (int32_t)(PIXELS / picture->stride);
    picture->pixels = pixels;
    for (i = 0; i < PIXELS; i++) {
        seed = seed * 1664525u + 1013904223u;
        pixels[i] = (uint8_t)((i / side & 1 ? dark : light) + (seed >> 29));
    }
    take_into(in, pixels + take_u16(in) % (PIXELS - 256), 1u + take_u8(in));
    if (picture->width_px > 0 && (size_t)picture->width_px > picture->stride)
        return; /* to be refused */
    if (picture->height_px > 8192)
        picture->height_px = 1;
}

/* A triangle, about as the shipped family's. */
static void make_outline(struct input *in)
{
    int i;

    memset(&outline, 0, sizeof outline);
    outline.samples = 36;
    outline.cells = 9;
    outline.passes = 3;
    outline.unit_m = number(in, 0.004);
    outline.scale_doubt = number(in, 0.12);
    outline.least_contrast = number(in, 25.0);
    outline.rims = 4;
    outline.rim_x_m[0] = outline.rim_y_m[1] = number(in, 0.03);
    outline.rim_x_m[2] = outline.rim_y_m[3] = -outline.rim_x_m[0];
    for (i = 0; i < outline.samples; i++) {
        double angle = 0.1745 * i;

        outline.x_m[i] = 0.02 * cos(angle);
        outline.y_m[i] = 0.012 * sin(angle);
        outline.normal_x[i] = cos(angle);
        outline.normal_y[i] = sin(angle);
    }
    for (i = 0; i < outline.cells * VS_OUTLINE_SPOTS; i++) {
        outline.spot_x_m[i] = 0.0005 * (i % 9) - 0.002;
        outline.spot_y_m[i] = 0.0005 * (i / 9.0) - 0.002;
    }
    for (i = 0; i < outline.passes; i++) {
        struct vs_outline_pass pass = {number(in, 0.003), 9, 1, number(in, 0.3), number(in, 0.01)};

        outline.stage[i] = pass;
    }
    if (take_u8(in) >= 250) {
        outline.samples = (int8_t)take_u8(in);
        outline.cells = (int8_t)take_u8(in);
        outline.passes = (int8_t)take_u8(in);
        outline.stage[1].steps = (int8_t)take_u8(in);
        outline.stage[2].stride = (int8_t)take_u8(in);
    }
}

/* A dictionary of five words of any size, and what blur makes of a line of any numbers. */
static void make_words(struct input *in)
{
    static uint64_t word[4 * TAGS];
    static uint8_t part[4 * TAGS * 11];
    static float per_length[VS_WORDS_KINDS * TAGS];
    int parts, i, k;

    memset(&words, 0, sizeof words);
    words.cells = 1 + take_u8(in) % VS_WORDS_CELLS;
    words.tags = TAGS;
    words.correction = take_u8(in) & 3;
    words.word = word;
    words.part = part;
    words.per_length[0] = words.per_length[1] = per_length;
    parts = (words.cells * words.cells + VS_WORDS_PART - 1) / VS_WORDS_PART;
    for (i = 0; i < 4 * TAGS; i++) {
        word[i] = take_u32(in) * (uint64_t)0x9E3779B97F4A7C15U;
        if (words.cells < VS_WORDS_CELLS)
            word[i] &= ((uint64_t)1 << words.cells * words.cells) - 1;
        for (k = 0; k < parts; k++)
            part[i * parts + k] = (uint8_t)(word[i] >> k * VS_WORDS_PART & 63);
    }
    for (i = 0; i < VS_WORDS_KINDS * TAGS; i++)
        per_length[i] = 1.0f / (float)(1 + i % 7);
    for (i = 0; i < VS_WORDS_BLURS; i++) {
        words.sharp[i] = 1.0 - 0.1 * i;
        for (k = 0; k < words.cells + 2; k++)
            words.seen[i][k + 1][k] = (float)number(in, 0.8);
    }
    words.cell_m = number(in, 0.003);
    words.turn_x = 1.0;
    words.centre_x_m = 0.001 * take_u8(in);
    outline.words = &words;
}

/* A roster of up to five tags, as many cells as there may be, and some numbers for their words. */
static void make_codes(struct input *in)
{
    static float word[VS_CODES_BLURS * VS_CODES_BLURS * VS_OUTLINE_CELLS * TAGS];
    static float most_error[VS_CODES_BLURS * VS_CODES_BLURS * TAGS];
    static int32_t tag[TAGS] = {0, 1, 7, 31, 65535};
    size_t i;

    if (word[0] == 0.0f)
        for (i = 0; i < sizeof word / sizeof word[0]; i++)
            word[i] = 0.25f * (float)(1 + i * 7 % 5);
    for (i = 0; i < sizeof most_error / sizeof most_error[0]; i++)
        most_error[i] = 0.3f;
    codes.cells = 1 + take_u8(in) % VS_OUTLINE_CELLS;
    codes.side = 1 + take_u8(in) % codes.cells;
    codes.tags = take_u8(in) % (TAGS + 1);
    codes.tag = tag;
    codes.word = word;
    codes.most_error = codes.per_length = most_error;
    for (i = 0; i < VS_CODES_BLURS; i++) {
        codes.lost[i] = number(in, 0.1);
        codes.sharp[i] = number(in, 1.0 - 0.05 * (double)i);
    }
    outline.codes = &codes;
}

static void make_lens(struct input *in, struct vs_view *view)
{
    static const double down[9] = {1, 0, 0, 0, -1, 0, 0, 0, -1};
    int i;

    view->lens.fx_px = number(in, 200.0);
    view->lens.fy_px = number(in, 200.0);
    view->lens.cx_px = number(in, 64.0);
    view->lens.cy_px = number(in, 64.0);
    for (i = 0; i < 5; i++)
        view->lens.distortion[i] = number(in, 0.01);
    for (i = 0; i < 9; i++)
        view->lens.rotation[i] = number(in, down[i]);
    for (i = 0; i < 3; i++)
        view->lens.position_m[i] = number(in, i == 2 ? 0.5 : 0.0);
    view->height_m = number(in, 0.05);
}

static void check_found(const struct vs_view *view, size_t count)
{
    size_t i;

    CHECK(count <= FOUND);
    for (i = 0; i < count; i++) {
        CHECK(isfinite(found[i].x_m) && isfinite(found[i].y_m) && isfinite(found[i].scale));
        CHECK(isfinite(found[i].ahead_x) && isfinite(found[i].ahead_y));
        CHECK(found[i].coverage >= 0.0 && found[i].coverage <= 1.0);
        CHECK(found[i].tag == -1.0 || outline.words != NULL || outline.codes != NULL);
        if (outline.words != NULL) /* a disc's middle may be outside where its square is inside */
            continue;
        CHECK(found[i].x_px >= -0.5 && found[i].x_px <= view->picture.width_px - 0.5);
        CHECK(found[i].y_px >= -0.5 && found[i].y_px <= view->picture.height_px - 0.5);
    }
}

static void follow(struct input *in, const struct vs_view *view)
{
    const struct vs_outline *first;
    size_t count = take_below(in, FOUND);
    size_t i;

    memset(found, 0, sizeof found);
    for (i = 0; i < count; i++) {
        found[i].x_m = number(in, 0.01);
        found[i].y_m = number(in, 0.01);
        found[i].ahead_x = number(in, 1.0);
        found[i].ahead_y = number(in, 0.1);
        found[i].scale = number(in, 1.0);
    }
    first = take_u8(in) % 2 != 0 ? &outline : NULL;
    if (vs_markers_follow(first, &outline, view, found, origin, &count) == VS_OK)
        check_found(view, count);
}

/* As many blocks as the picture has, and not one byte more; none for what is no picture. */
static uint8_t *make_mask(struct input *in, const struct vs_picture *picture)
{
    size_t width = (size_t)picture->width_px, height = (size_t)picture->height_px, blocks, i;
    uint8_t share = take_u8(in);
    uint8_t *mask;

    if (picture->width_px < 1 || picture->height_px < 1 || width > VS_MARKERS_SIDE ||
        height > VS_MARKERS_SIDE)
        return NULL;
    blocks = ((width + VS_MARKERS_BLOCK - 1) / VS_MARKERS_BLOCK) *
             ((height + VS_MARKERS_BLOCK - 1) / VS_MARKERS_BLOCK);
    mask = malloc(blocks);
    for (i = 0; mask != NULL && i < blocks; i++)
        mask[i] = (uint8_t)(i * 37) < share;
    return mask;
}

/* As the shipped family is searched for, or with any numbers. */
static void make_search(struct input *in, struct vs_search *search)
{
    static const struct vs_shape_gate gate = {7.0, 29.0, 15.0, 600.0, 0.0, 1e9, 1.0, 9.0, 0.0, 0.0};

    memset(search, 0, sizeof *search);
    search->least_apart_m = 0.03;
    search->gate = gate;
    search->least_contrast = (int8_t)take_u8(in);
    search->level_256 = take_u16(in) % 300;
    search->lead_m = number(in, 0.005);
    search->gate.least_px = number(in, 10.0);
    search->gate.most_px = number(in, 43.0);
    search->gate.least_px2 = number(in, 30.0);
    search->gate.most_px2 = number(in, 1200.0);
}

static void take_rescans(struct input *in, struct vs_search *search)
{
    int i;

    search->print_256 = take_u16(in) % 300;
    search->has_veil = take_u8(in) & 1;
    search->pale_contrast = take_u8(in);
    search->pale_fit = number(in, 0.3);
    for (i = 0; i < VS_MARKERS_AGAIN; i++) {
        search->again[i].level_256 = take_u16(in) % 300;
        search->again[i].least_light = take_u16(in) % 300;
    }
}

/* Right angles that are looked for in what is larger than a marker. */
static void take_corners(struct input *in, struct vs_search *search)
{
    int i;

    search->corners = take_u8(in) % (VS_MARKERS_CORNERS + 1);
    search->wanted = take_u8(in) & 7;
    search->corner_side_m = number(in, 0.03);
    for (i = 0; i < search->corners; i++) {
        double angle = 0.0245 * take_u8(in);

        search->corner[i].x_m = number(in, 0.02);
        search->corner[i].y_m = number(in, 0.02);
        search->corner[i].ahead = cos(angle);
        search->corner[i].left = sin(angle);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct input in = {data, size};
    struct vs_search search;
    struct vs_window window;
    struct vs_view view;
    uint8_t *skipped;
    size_t count = 0;
    int full;

    if (memory == NULL)
        memory = malloc(vs_markers_size(400, VS_MARKERS_SIDE));
    memset(&view, 0, sizeof view);
    take_picture(&in, &view.picture);
    make_outline(&in);
    make_lens(&in, &view);
    make_search(&in, &search);
    window.left = (int16_t)take_u16(&in);
    window.top = (int16_t)take_u16(&in);
    window.right = take_u8(&in) & 7 ? view.picture.width_px : (int32_t)take_u32(&in);
    window.bottom = take_u8(&in) & 7 ? view.picture.height_px : (int32_t)take_u32(&in);
    if (take_u8(&in) & 1)
        window.left = window.top = 0;
    take_rescans(&in, &search);
    if (take_u8(&in) & 1) {
        make_words(&in);
        search.gate.least_square = number(&in, 0.1);
    }
    if (take_u8(&in) & 1)
        make_codes(&in);
    skipped = NULL;
    if (take_u8(&in) & 1)
        search.outside = skipped = make_mask(&in, &view.picture);
    if (take_u8(&in) & 1)
        take_corners(&in, &search);
    full = vs_markers_search((struct vs_markers *)(void *)memory, &search, &outline, &view, &window,
                             found, FOUND, &count);
    free(skipped);
    if (full >= 0)
        check_found(&view, count);
    follow(&in, &view);
    return 0;
}
