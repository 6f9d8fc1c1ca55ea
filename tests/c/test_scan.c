/* SPDX-License-Identifier: MIT */
/* The picture kernel on drawn markers, and on bytes of any kind in any shape. */
#include "vs_markers.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "vs_lens.h"
#include "vs_outline.h"
#include "vs_scan.h"

#define WIDTH 320
#define HEIGHT 240
#define CAPACITY 8

static uint32_t seed = 1;

static uint32_t any(uint32_t below)
{
    seed = seed * 1664525U + 1013904223U;
    return (seed >> 8) % below;
}

/* The arrow of the family arrow4x4, without cells: 5.3 mm units from the disc's centre. */
static void make_outline(struct vs_outline *o)
{
    static const double corner[5][2] = {{-3, -3}, {3, -3}, {6, 0}, {3, 3}, {-3, 3}};
    const double unit_m = 0.0053;
    int edge, k;

    memset(o, 0, sizeof *o);
    for (edge = 0; edge < 5; edge++) {
        const double *a = corner[edge], *b = corner[(edge + 1) % 5];
        double dx = b[0] - a[0], dy = b[1] - a[1];
        double length = sqrt(dx * dx + dy * dy);

        for (k = 0; k < 10; k++, o->samples++) {
            double share = 0.15 + 0.7 * k / 9.0;

            o->x_m[o->samples] = unit_m * (a[0] + share * dx - 1.5);
            o->y_m[o->samples] = unit_m * (a[1] + share * dy);
            o->normal_x[o->samples] = dy / length;
            o->normal_y[o->samples] = -dx / length;
        }
    }
    o->cells = 16;
    o->passes = 2;
    o->unit_m = unit_m;
    o->scale_doubt = 0.12;
    o->least_contrast = 25.0;
    o->rims = 4;
    o->rim_x_m[0] = o->rim_y_m[1] = 0.035;
    o->rim_x_m[2] = o->rim_y_m[3] = -0.035;
    for (k = 0; k < 2; k++) {
        o->stage[k].reach_m = (k == 0 ? 1.0 : 0.6) * unit_m;
        o->stage[k].steps = 11;
        o->stage[k].stride = 1;
        o->stage[k].least_coverage = k == 0 ? 0.6 : 0.8;
        o->stage[k].most_residual_m = (k == 0 ? 0.25 : 0.1) * unit_m;
    }
}

/* A camera 2 m above the markers that looks down: 1.25 mm per pixel. */
static void make_view(struct vs_view *v, const uint8_t *pixels, size_t stride, int width,
                      int height)
{
    memset(v, 0, sizeof *v);
    v->picture.pixels = pixels;
    v->picture.stride = stride;
    v->picture.width_px = width;
    v->picture.height_px = height;
    v->lens.fx_px = v->lens.fy_px = 1600.0;
    v->lens.cx_px = 0.5 * (width - 1);
    v->lens.cy_px = 0.5 * (height - 1);
    v->lens.rotation[0] = 1.0;
    v->lens.rotation[4] = v->lens.rotation[8] = -1.0;
    v->lens.position_m[2] = 2.0;
}

static void make_search(struct vs_search *s)
{
    memset(s, 0, sizeof *s);
    s->least_contrast = 36;
    s->level_256 = 100;
    s->print_256 = 102;
    s->lead_m = 0.0053 * (1.5 - 0.8);
    s->least_apart_m = 0.035;
    s->gate.least_px = 0.35 * 9.5 * 0.0053 * 800.0;
    s->gate.most_px = 1.45 * 9.5 * 0.0053 * 800.0;
    s->gate.least_m2 = 0.4 * 45.0 * 0.0053 * 0.0053;
    s->gate.most_m2 = 1.6 * 45.0 * 0.0053 * 0.0053;
    s->gate.least_px2 = s->gate.least_m2 * 800.0 * 800.0;
    s->gate.most_px2 = s->gate.most_m2 * 800.0 * 800.0;
    s->gate.least_aspect = 1.2;
    s->gate.most_aspect = 2.9;
    s->gate.least_taper = 0.12;
}

/* The share of a pixel that a marker's ink covers, by 16 samples. */
static double ink(double x_m, double y_m, double c, double s, const double at_m[2])
{
    int covered = 0, k;

    for (k = 0; k < 16; k++) {
        double dx = x_m - at_m[0] + 0.00125 * ((k % 4) - 1.5) / 4.0;
        double dy = y_m - at_m[1] + 0.00125 * ((double)k / 4 - (k % 4) / 4.0 - 1.5) / 4.0;
        double u = (c * dx + s * dy) / 0.0053 + 1.5, v = (c * dy - s * dx) / 0.0053;

        v = v < 0.0 ? -v : v;
        covered += u >= -3.0 && v <= 3.0 && u + v <= 6.0;
    }
    return covered / 16.0;
}

static void draw(uint8_t *pixels, double c, double s, const double at_m[2])
{
    int x, y;

    for (y = 0; y < HEIGHT; y++) {
        for (x = 0; x < WIDTH; x++) {
            double x_m = (x - 0.5 * (WIDTH - 1)) * 0.00125;
            double y_m = -(y - 0.5 * (HEIGHT - 1)) * 0.00125;
            double far2 = (x_m - at_m[0]) * (x_m - at_m[0]) + (y_m - at_m[1]) * (y_m - at_m[1]);
            double white = far2 < 0.035 * 0.035 ? 200.0 : 110.0;

            pixels[y * WIDTH + x] =
                (uint8_t)(white + (30.0 - white) * ink(x_m, y_m, c, s, at_m) + 0.5);
        }
    }
}

static struct vs_markers *work;
static struct vs_marker found[CAPACITY];
static const struct vs_window everything = {0, 0, VS_SCAN_SIDE, VS_SCAN_SIDE};

static void test_an_arrow_is_found_where_it_is(void)
{
    static uint8_t pixels[WIDTH * HEIGHT];
    static const double turn[6][2] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}, {0.6, 0.8}, {-0.8, 0.6}};
    struct vs_outline outline;
    struct vs_search search;
    struct vs_view view;
    int k;

    make_outline(&outline);
    make_search(&search);
    make_view(&view, pixels, WIDTH, WIDTH, HEIGHT);
    for (k = 0; k < 6; k++) {
        double at_m[2], x, y;
        size_t count = 0;

        at_m[0] = 0.0003 * k - 0.02;
        at_m[1] = 0.01 - 0.0007 * k;
        draw(pixels, turn[k][0], turn[k][1], at_m);
        CHECK(vs_markers_search(work, &search, &outline, &view, &everything, found, CAPACITY,
                                &count) == VS_OK);
        CHECK(count == 1);
        x = found[0].x_m - at_m[0];
        y = found[0].y_m - at_m[1];
        CHECK(x * x + y * y < 1e-4 * 1e-4);
        CHECK(found[0].ahead_x * turn[k][0] + found[0].ahead_y * turn[k][1] > 0.9999);
        CHECK(found[0].white - found[0].black > 150.0 && found[0].cell[5] < 0.05);
    }
}

/* A marker that is known is found again from near; one that is not there is not. */
static void test_a_known_arrow_is_followed(void)
{
    static uint8_t pixels[WIDTH * HEIGHT];
    const double at_m[2] = {0.01, 0.005};
    struct vs_outline outline;
    struct vs_view view;
    uint32_t origin[2];
    size_t count = 2;

    make_outline(&outline);
    make_view(&view, pixels, WIDTH, WIDTH, HEIGHT);
    draw(pixels, 1.0, 0.0, at_m);
    memset(found, 0, sizeof found);
    found[0].x_m = -0.08;
    found[1].x_m = 0.011;
    found[1].y_m = 0.0045;
    found[0].ahead_x = found[1].ahead_x = found[0].scale = found[1].scale = 1.0;
    CHECK(vs_markers_follow(NULL, &outline, &view, found, origin, &count) == VS_OK);
    CHECK(count == 1 && origin[0] == 1);
    CHECK(found[0].x_m > 0.0098 && found[0].x_m < 0.0102);
}

/* What is in blocks that are to be skipped is not there; a window has no such blocks. */
static void test_skipped_blocks_show_nothing(void)
{
    enum { BLOCKS = ((WIDTH + VS_MARKERS_BLOCK - 1) / VS_MARKERS_BLOCK) *
                    ((HEIGHT + VS_MARKERS_BLOCK - 1) / VS_MARKERS_BLOCK) };
    static uint8_t pixels[WIDTH * HEIGHT];
    const struct vs_window part = {1, 0, WIDTH, HEIGHT};
    const double at_m[2] = {0.0, 0.0};
    uint8_t *outside = calloc(BLOCKS, 1);
    struct vs_outline outline;
    struct vs_search search;
    struct vs_view view;
    size_t count = 0;

    CHECK(outside != NULL);
    make_outline(&outline);
    make_search(&search);
    make_view(&view, pixels, WIDTH, WIDTH, HEIGHT);
    draw(pixels, 1.0, 0.0, at_m);
    search.outside = outside;
    CHECK(vs_markers_search(work, &search, &outline, &view, &everything, found, CAPACITY,
                            &count) == VS_OK && count == 1);
    memset(outside, 1, BLOCKS);
    count = 0;
    CHECK(vs_markers_search(work, &search, &outline, &view, &everything, found, CAPACITY,
                            &count) == VS_OK && count == 0);
    CHECK(vs_markers_search(work, &search, &outline, &view, &part, found, CAPACITY,
                            &count) == VS_OK && count == 1);
    free(outside);
}

static void fill(uint8_t *pixels, size_t size, uint32_t kind)
{
    size_t i;

    for (i = 0; i < size; i++)
        pixels[i] = kind == 0 ? (uint8_t)any(256)
                  : kind == 1 ? (uint8_t)(any(2) * 255)
                  : kind == 2 ? 0 : kind == 3 ? 255 : (uint8_t)(i / 7 % 2 * 200);
}

/* Pictures of all shapes in memory that ends with the last pixel. */
static void test_any_bytes_in_any_shape_do_no_harm(void)
{
    struct vs_outline outline;
    struct vs_search search;
    int round;

    make_outline(&outline);
    make_search(&search);
    for (round = 0; round < 300; round++) {
        int width = round < 40 ? 1 + round : 1 + (int)any(300);
        int height = round < 40 ? 1 + (int)any(40) : 1 + (int)any(300);
        size_t stride = (size_t)width + any(20);
        size_t size = stride * (size_t)(height - 1) + (size_t)width;
        uint8_t *pixels = malloc(size);
        struct vs_window window;
        struct vs_view view;
        size_t count = 0;

        CHECK(pixels != NULL);
        if (pixels == NULL)
            return;
        fill(pixels, size, (uint32_t)round % 5);
        make_view(&view, pixels, stride, width, height);
        window.left = (int32_t)any(400) - 100;
        window.top = (int32_t)any(400) - 100;
        window.right = (int32_t)any(500) - 100;
        window.bottom = (int32_t)any(500) - 100;
        CHECK(vs_markers_search(work, &search, &outline, &view,
                                round % 3 == 0 ? &window : &everything, found, CAPACITY,
                                &count) == VS_OK);
        CHECK(count <= CAPACITY);
        free(pixels);
    }
}

static void test_a_full_table_is_reported(void)
{
    static uint8_t noise[1200 * 1600];
    struct vs_outline outline;
    struct vs_search search;
    struct vs_view view;
    size_t count = 0;
    int full;

    make_outline(&outline);
    make_search(&search);
    fill(noise, sizeof noise, 0);
    make_view(&view, noise, 1600, 1600, 1200);
    full = vs_markers_search(work, &search, &outline, &view, &everything, found, CAPACITY,
                             &count);
    CHECK(full == VS_MARKERS_FULL_RUNS || full == VS_MARKERS_FULL_PARTS);
}

/* Stripes that are dark for the second threshold only, and a dot in each block for its darkest. */
static void test_a_table_that_the_second_scan_fills_is_reported(void)
{
    static uint8_t pixels[1200 * 1600];
    struct vs_outline outline;
    struct vs_search search;
    struct vs_view view;
    size_t count = 0;
    int x, y;

    for (y = 0; y < 1200; y++)
        for (x = 0; x < 1600; x++)
            pixels[y * 1600 + x] = x % 16 == 0 && y % 16 == 0 ? 0 : x % 4 < 2 ? 90 : 200;
    make_outline(&outline);
    make_search(&search);
    make_view(&view, pixels, 1600, 1600, 1200);
    CHECK(vs_markers_search(work, &search, &outline, &view, &everything, found, CAPACITY,
                            &count) == VS_OK);
    search.again[0].level_256 = 128;
    CHECK(vs_markers_search(work, &search, &outline, &view, &everything, found, CAPACITY,
                            &count) == VS_MARKERS_FULL_RUNS);
}

/* Stripes of three dark pixels and as many light ones, in columns; every run is a row's own. */
static void stripe(uint8_t *pixels, int width, int height, int apart)
{
    int x, y;

    for (y = 0; y < height; y++)
        for (x = 0; x < width; x++)
            pixels[(size_t)y * (size_t)width + (size_t)x] = x % apart < apart / 2 ? 20 : 220;
}

/* In memory of the size asked for: what a large picture has is scanned down to the last row. */
static void test_the_tables_follow_the_pictures_size(void)
{
    static const int size[3][2] = {{4000, 3000}, {8192, 2000}, {2000, 8192}};
    const double at_m[2] = {0.0, 0.0};
    static uint8_t small[WIDTH * HEIGHT];
    struct vs_outline outline;
    struct vs_search search;
    int k, y;

    make_outline(&outline);
    make_search(&search);
    draw(small, 1.0, 0.0, at_m);
    for (k = 0; k < 3; k++) {
        int width = size[k][0], height = size[k][1];
        uint8_t *pixels = malloc((size_t)width * (size_t)height);
        struct vs_markers *large = malloc(vs_markers_size(width, height));
        struct vs_view view;
        size_t count = 0;

        CHECK(pixels != NULL && large != NULL);
        if (pixels == NULL || large == NULL)
            return;
        stripe(pixels, width, height, 20);
        for (y = 0; y < HEIGHT; y++)
            memcpy(pixels + (size_t)(height - HEIGHT + y) * (size_t)width, small + y * WIDTH, WIDTH);
        make_view(&view, pixels, (size_t)width, width, height);
        CHECK((uint32_t)(width / 20) * (uint32_t)(height / 2) > VS_SCAN_RUNS);
        CHECK(vs_markers_search(large, &search, &outline, &view, &everything, found, CAPACITY,
                                &count) == VS_OK);
        CHECK(count == 1);
        fill(pixels, (size_t)width * (size_t)height, 0);
        CHECK(vs_markers_search(large, &search, &outline, &view, &everything, found, CAPACITY,
                                &count) >= VS_OK);
        free(large);
        free(pixels);
    }
}

/* As much as before for what a camera of two megapixels shows, and never less. */
static void test_room_grows_with_the_picture_only(void)
{
    size_t least = vs_markers_size(1, 1);

    CHECK(vs_markers_size(1620, 1220) == least && vs_markers_size(-1, 70000) == least);
    CHECK(vs_markers_size(4000, 3000) > least);
    CHECK(vs_markers_size(4000, 3000) - least < 6u << 20);
    CHECK(vs_markers_size(8192, 8192) == vs_markers_size(70000, 70000));
}

static void test_no_room_for_a_marker_is_reported(void)
{
    static uint8_t pixels[WIDTH * HEIGHT];
    const double at_m[2] = {0.0, 0.0};
    struct vs_outline outline;
    struct vs_search search;
    struct vs_view view;
    size_t count = 0;

    make_outline(&outline);
    make_search(&search);
    make_view(&view, pixels, WIDTH, WIDTH, HEIGHT);
    draw(pixels, 1.0, 0.0, at_m);
    CHECK(vs_markers_search(work, &search, &outline, &view, &everything, found, 0, &count) ==
          VS_MARKERS_FULL_FOUND);
    CHECK(count == 0);
}

static void test_wrong_arguments_are_refused(void)
{
    static uint8_t pixels[WIDTH * HEIGHT];
    static struct vs_scan scan;
    struct vs_picture picture = {pixels, WIDTH, WIDTH, HEIGHT};
    struct vs_outline outline;
    struct vs_search search;
    int k;

    for (k = 0; k < 8; k++) {
        struct vs_picture wrong = picture;

        make_search(&search);
        search.level_256 = k == 4 ? 0 : k == 5 ? 256 : 100;
        search.print_256 = k == 6 ? -1 : k == 7 ? 257 : 102;
        wrong.width_px = k == 0 ? 0 : k == 1 ? VS_SCAN_SIDE + 1 : WIDTH;
        wrong.height_px = k == 2 ? -1 : HEIGHT;
        wrong.stride = k == 3 ? WIDTH - 1 : WIDTH;
        CHECK(vs_scan_picture(&scan, &wrong, &search) == VS_ERR_ARGUMENT);
    }
    make_outline(&outline);
    CHECK(vs_outline_check(&outline) == VS_OK);
    outline.stage[1].steps = VS_OUTLINE_STEPS + 1;
    CHECK(vs_outline_check(&outline) == VS_ERR_ARGUMENT);
    make_outline(&outline);
    outline.samples = VS_OUTLINE_SAMPLES + 1;
    CHECK(vs_outline_check(&outline) == VS_ERR_ARGUMENT);
    make_outline(&outline);
    outline.stage[1].reach_m = -0.001;
    CHECK(vs_outline_check(&outline) == VS_ERR_ARGUMENT);
    make_outline(&outline);
    outline.rims = VS_OUTLINE_RIM + 1;
    CHECK(vs_outline_check(&outline) == VS_ERR_ARGUMENT);
    make_outline(&outline);
    outline.unit_m = -1e170;
    CHECK(vs_outline_check(&outline) == VS_ERR_ARGUMENT);
}

/* Found by fuzzing: nothing of a picture of negative size is touched. */
static void test_a_negative_size_is_refused(void)
{
    static uint8_t pixels[WIDTH * HEIGHT];
    struct vs_outline outline;
    struct vs_search search;
    struct vs_view view;
    size_t count = 0;

    make_outline(&outline);
    make_search(&search);
    make_view(&view, pixels, WIDTH, -1, HEIGHT);
    CHECK(vs_markers_search(work, &search, &outline, &view, &everything, found, CAPACITY,
                            &count) == VS_ERR_ARGUMENT);
    make_view(&view, pixels, WIDTH, WIDTH, -1);
    CHECK(vs_markers_search(work, &search, &outline, &view, &everything, found, CAPACITY,
                            &count) == VS_ERR_ARGUMENT);
}

/* Windows and poses are no way around that: a place beyond 32767 px has no number. */
static void test_a_part_of_a_picture_that_is_too_large_is_refused(void)
{
    static uint8_t pixels[WIDTH * HEIGHT];
    static const int32_t size[3][2] = {{VS_MARKERS_SIDE + 1, 2}, {2, VS_MARKERS_SIDE + 1}, {3, 2}};
    struct vs_window corner = {0, 0, 2, 2};
    uint32_t origin[CAPACITY];
    struct vs_outline outline;
    struct vs_search search;
    struct vs_view view;
    size_t count, k;

    make_outline(&outline);
    make_search(&search);
    for (k = 0; k < 3; k++) {
        make_view(&view, pixels, k == 2 ? 2 : (size_t)size[k][0], size[k][0], size[k][1]);
        count = 0;
        CHECK(vs_markers_search(work, &search, &outline, &view, &corner, found, CAPACITY,
                                &count) == VS_ERR_ARGUMENT);
        memset(found, 0, sizeof found[0]);
        count = 1;
        CHECK(vs_markers_follow(NULL, &outline, &view, found, origin, &count) ==
              VS_ERR_ARGUMENT);
        CHECK(count == 0);
    }
}

/* Found by fuzzing: where a lens folds a side has more pixels than an integer holds. */
static void test_sides_longer_than_any_border_have_no_corners(void)
{
    static const double side_m[4] = {0.02, 30.0, 1e9, NAN};
    static uint8_t pixels[WIDTH * HEIGHT];
    struct vs_outline outline;
    struct vs_search search;
    struct vs_view view;
    size_t count, k;
    int y;

    memset(pixels, 200, sizeof pixels);
    for (y = 20; y < 100; y++)
        memset(pixels + y * WIDTH + 20, 30, 80);
    make_outline(&outline);
    make_search(&search);
    make_view(&view, pixels, WIDTH, WIDTH, HEIGHT);
    search.corners = search.wanted = 1;
    search.corner[0].ahead = 1.0;
    for (k = 0; k < 4; k++) {
        search.corner_side_m = side_m[k];
        CHECK(vs_markers_search(work, &search, &outline, &view, &everything, found, CAPACITY,
                                &count) >= 0);
        CHECK(count == 0);
    }
}

/* A camera that leans and whose lens distorts: what is seen of a plane is found there. */
static void test_the_lens_and_back(void)
{
    static const double distortion[5] = {-0.12, 0.02, 0.001, -0.002, 0.003};
    struct vs_view view;
    double point[3], pixel[2], back[2];
    int i;

    make_view(&view, NULL, 0, 1620, 1220);
    memcpy(view.lens.distortion, distortion, sizeof distortion);
    view.lens.rotation[4] = view.lens.rotation[8] = -0.8;
    view.lens.rotation[5] = -0.6;
    view.lens.rotation[7] = 0.6;
    view.lens.position_m[1] = -1.5;
    for (i = 0; i < 1000; i++) {
        point[0] = (double)any(1000) / 1250.0 - 0.4;
        point[1] = (double)any(1000) / 1250.0 - 0.4;
        point[2] = (double)any(1000) / 1000.0 - 0.5;
        CHECK(vs_lens_project(&view.lens, point, pixel) == VS_OK);
        CHECK(vs_lens_to_plane(&view.lens, pixel, point[2], back) == VS_OK);
        CHECK(fabs(back[0] - point[0]) < 1e-6 && fabs(back[1] - point[1]) < 1e-6);
    }
}

static void test_what_is_behind_a_camera_is_not_seen(void)
{
    static const double above[3] = {0.0, 0.0, 3.0}, middle[2] = {0.0, 0.0};
    struct vs_view view;
    double pixel[2];

    make_view(&view, NULL, 0, WIDTH, HEIGHT);
    CHECK(vs_lens_project(&view.lens, above, pixel) == VS_ERR_ARGUMENT);
    CHECK(vs_lens_to_plane(&view.lens, middle, 3.0, pixel) == VS_ERR_ARGUMENT);
}

int main(void)
{
    work = malloc(vs_markers_size(1620, 1220));
    CHECK(work != NULL);
    test_an_arrow_is_found_where_it_is();
    test_a_known_arrow_is_followed();
    test_skipped_blocks_show_nothing();
    test_any_bytes_in_any_shape_do_no_harm();
    test_a_full_table_is_reported();
    test_a_table_that_the_second_scan_fills_is_reported();
    test_the_tables_follow_the_pictures_size();
    test_room_grows_with_the_picture_only();
    test_no_room_for_a_marker_is_reported();
    test_wrong_arguments_are_refused();
    test_a_negative_size_is_refused();
    test_sides_longer_than_any_border_have_no_corners();
    test_a_part_of_a_picture_that_is_too_large_is_refused();
    test_the_lens_and_back();
    test_what_is_behind_a_camera_is_not_seen();
    free(work);
    return 0;
}
