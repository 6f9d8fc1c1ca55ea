/* SPDX-License-Identifier: MIT */
/* Square markers: their words, their outline in a picture, and cells of any values; with
 * VS_TEST_THREADS, two threads that search the same picture, under ThreadSanitizer. */
#include "vs_words.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"

#define CELLS 4
#define TAGS 3
#define SPAN (CELLS + 4)
#define WIDTH 200
#define HEIGHT 160
#define CELL_M 0.0075
#define PER_M 800.0

/* Three words, upright; that of tag 1 has an L in a corner. */
static const char *const upright[TAGS] = {"1000110001100011", "1111100010000000",
                                          "0110101101011010"};

static uint64_t word[4 * TAGS];
static uint8_t part[4 * TAGS * 3];
static float per_length[2][VS_WORDS_KINDS * TAGS];
static struct vs_words words;
static uint32_t seed = 1;

static uint32_t any(uint32_t below)
{
    seed = seed * 1664525U + 1013904223U;
    return (seed >> 8) % below;
}

/* Whether a cell is white, of a tag turned counter-clockwise; -1 and CELLS are the frame. */
static int is_white(int tag, int turn, int row, int column)
{
    int k, swap;

    if (row < -1 || row > CELLS || column < -1 || column > CELLS)
        return 1;
    if (row < 0 || row == CELLS || column < 0 || column == CELLS)
        return 0;
    for (k = 0; k < turn; k++) {
        swap = row;
        row = column;
        column = CELLS - 1 - swap;
    }
    return upright[tag][row * CELLS + column] == '1';
}

/* What is seen of a word, with a slope of the light. */
static void show(int tag, int turn, double slope, float *cells)
{
    int row, column;

    for (row = 0; row < SPAN; row++) {
        for (column = 0; column < SPAN; column++)
            cells[row * SPAN + column] =
                (float)(40.0 + 160.0 * is_white(tag, turn, row - 2, column - 2) + slope * row);
    }
}

/* The length of a word that is seen sharply, without mean and slope. */
static double length_of(int tag, int ring)
{
    double sum = 0.0, squares = 0.0, x = 0.0, y = 0.0, far = 0.0, count = 0.0;
    int row, column, low = ring ? 0 : 1;

    for (row = low; row < SPAN - low; row++) {
        for (column = low; column < SPAN - low; column++) {
            double grey = is_white(tag, 0, row - 2, column - 2);
            double right = column - 0.5 * (SPAN - 1), down = row - 0.5 * (SPAN - 1);

            if (ring && (row == 0 || row == SPAN - 1) && (column == 0 || column == SPAN - 1))
                continue;
            sum += grey;
            squares += grey * grey;
            x += right * grey;
            y += down * grey;
            far += right * right;
            count += 1.0;
        }
    }
    return sqrt(squares - sum * sum / count - (x * x + y * y) / far);
}

static void make_words(void)
{
    int tag, turn, k, blur, kind, ring;

    words.cells = CELLS;
    words.tags = TAGS;
    words.correction = 1;
    words.word = word;
    words.part = part;
    for (tag = 0; tag < TAGS; tag++) {
        for (turn = 0; turn < 4; turn++) {
            for (k = 0; k < CELLS * CELLS; k++) {
                if (is_white(tag, turn, k / CELLS, k % CELLS))
                    word[4 * tag + turn] |= (uint64_t)1 << k;
            }
            for (k = 0; k < 3; k++)
                part[(4 * tag + turn) * 3 + k] =
                    (uint8_t)(word[4 * tag + turn] >> (k * VS_WORDS_PART) & 63);
        }
    }
    for (ring = 0; ring < 2; ring++) {
        words.per_length[ring] = per_length[ring];
        for (kind = 0; kind < VS_WORDS_KINDS; kind++) {
            words.least_match[ring][kind] = 0.9;
            for (tag = 0; tag < TAGS; tag++)
                per_length[ring][kind * TAGS + tag] = (float)(1.0 / length_of(tag, ring));
        }
    }
    for (blur = 0; blur < VS_WORDS_BLURS; blur++) {
        words.sharp[blur] = 1.0 - 0.1 * blur;
        for (k = 0; k < CELLS + 2; k++)
            words.seen[blur][k + 1][k] = 1.0F;
    }
    words.cell_m = CELL_M;
    words.turn_y = 1.0; /* the robot drives to the marker's left */
    words.centre_x_m = 0.002;
}

static void test_every_word_is_read_in_every_turn(void)
{
    static const int32_t level[2] = {1, 2};
    float cells[SPAN * SPAN];
    struct vs_reading reading;
    int tag, turn;

    for (tag = 0; tag < TAGS; tag++) {
        for (turn = 0; turn < 4; turn++) {
            show(tag, turn, 3.0, cells);
            vs_words_read(&words, cells, level, 1, &reading);
            CHECK(reading.sure && reading.tag == tag && reading.turn == turn);
            CHECK(reading.error < 1e-3 && reading.margin > 10.0);
        }
    }
}

static void test_the_white_around_may_be_covered(void)
{
    static const int32_t level[2] = {0, 0};
    float cells[SPAN * SPAN];
    struct vs_reading reading;
    int k;

    show(1, 3, 0.0, cells);
    for (k = 0; k < SPAN; k++)
        cells[k] = cells[SPAN * (SPAN - 1) + k] = 40.0F;
    vs_words_read(&words, cells, level, 1, &reading);
    CHECK(reading.sure && reading.tag == 1 && reading.turn == 3);
}

static void test_wrong_cells_are_not_believed(void)
{
    static const int32_t level[2] = {0, 0};
    float cells[SPAN * SPAN];
    struct vs_reading reading;
    int k;

    show(2, 0, 0.0, cells);
    for (k = 2; k < 6; k++)
        cells[3 * SPAN + k] = 240.0F - cells[3 * SPAN + k];
    vs_words_read(&words, cells, level, 1, &reading);
    CHECK(!reading.sure);
    for (k = 0; k < SPAN * SPAN; k++)
        cells[k] = 90.0F;
    vs_words_read(&words, cells, level, 1, &reading);
    CHECK(!reading.sure);
}

/* Cells of any kind, several at once: what is said are a word and numbers. */
static void test_any_cells_do_no_harm(void)
{
    static const float odd[4] = {0.0F, 255.0F, -1e30F, 1e30F};
    struct vs_reading readings[2];
    int round, k;

    for (round = 0; round < 3000; round++) {
        float *cells = malloc(2 * SPAN * SPAN * sizeof *cells);
        int32_t level[4];

        CHECK(cells != NULL);
        if (cells == NULL)
            return;
        for (k = 0; k < 2 * SPAN * SPAN; k++)
            cells[k] = round % 7 == 0 ? odd[any(4)] : (float)any(256);
        for (k = 0; k < 4; k++)
            level[k] = (int32_t)any(VS_WORDS_BLURS);
        vs_words_read(&words, cells, level, 2, readings);
        for (k = 0; k < 2; k++) {
            CHECK(readings[k].tag >= (readings[k].sure ? 0 : -1) && readings[k].tag < TAGS);
            CHECK(readings[k].turn >= 0 && readings[k].turn < 4);
            CHECK(!readings[k].sure || isfinite(readings[k].error));
        }
        free(cells);
    }
}

/* The outline of the black square, from its middle. */
static void make_outline(struct vs_outline *o)
{
    static const double corner[5][2] = {{3, 3}, {-3, 3}, {-3, -3}, {3, -3}, {3, 3}};
    int side, k;

    memset(o, 0, sizeof *o);
    o->words = &words;
    o->passes = 2;
    o->rims = 4;
    o->unit_m = CELL_M;
    o->scale_doubt = 0.12;
    o->least_contrast = 8.0;
    for (side = 0; side < 4; side++) {
        const double *a = corner[side], *b = corner[side + 1];

        o->rim_x_m[side] = CELL_M * a[0];
        o->rim_y_m[side] = CELL_M * a[1];
        for (k = 0; k < 16; k++, o->samples++) {
            double share = 0.1 + 0.8 * k / 15.0;

            o->x_m[o->samples] = CELL_M * (a[0] + share * (b[0] - a[0]));
            o->y_m[o->samples] = CELL_M * (a[1] + share * (b[1] - a[1]));
            o->normal_x[o->samples] = (b[1] - a[1]) / 6.0;
            o->normal_y[o->samples] = (a[0] - b[0]) / 6.0;
        }
    }
    for (k = 0; k < 2; k++) {
        o->stage[k].reach_m = (k == 0 ? 1.0 : 0.6) * CELL_M;
        o->stage[k].steps = 11;
        o->stage[k].stride = 1;
        o->stage[k].least_coverage = 0.6;
        o->stage[k].most_residual_m = (k == 0 ? 0.3 : 0.15) * CELL_M;
    }
}

static void make_view(struct vs_view *v, const uint8_t *pixels)
{
    memset(v, 0, sizeof *v);
    v->picture.pixels = pixels;
    v->picture.stride = WIDTH;
    v->picture.width_px = WIDTH;
    v->picture.height_px = HEIGHT;
    v->lens.fx_px = v->lens.fy_px = 2.0 * PER_M;
    v->lens.cx_px = 0.5 * (WIDTH - 1);
    v->lens.cy_px = 0.5 * (HEIGHT - 1);
    v->lens.rotation[0] = 1.0;
    v->lens.rotation[4] = v->lens.rotation[8] = -1.0;
    v->lens.position_m[2] = 2.0;
}

static void make_search(struct vs_search *s)
{
    memset(s, 0, sizeof *s);
    s->least_contrast = 16;
    s->level_256 = 110;
    s->print_256 = 80;
    s->has_veil = 1;
    s->least_apart_m = 0.035;
    s->gate.least_px = 0.35 * 6.0 * CELL_M * PER_M * sqrt(2.0);
    s->gate.most_px = 1.45 * 6.0 * CELL_M * PER_M * sqrt(2.0);
    s->gate.least_m2 = 0.4 * 36.0 * CELL_M * CELL_M;
    s->gate.most_m2 = 1.6 * 36.0 * CELL_M * CELL_M;
    s->gate.least_px2 = s->gate.least_m2 * PER_M * PER_M;
    s->gate.most_px2 = s->gate.most_m2 * PER_M * PER_M;
    s->gate.least_aspect = 1.0;
    s->gate.most_aspect = 1.7;
    s->gate.least_square = 0.2;
}

/* A disc at the picture's middle whose robot heads along (c, s); black is 30 and white 200. */
static void draw(uint8_t *pixels, int tag, double c, double s)
{
    double up[2], middle[2];
    int x, y, k;

    up[0] = s; /* the marker's upright direction is to the robot's right */
    up[1] = -c;
    middle[0] = -words.centre_x_m * c;
    middle[1] = -words.centre_x_m * s;
    for (y = 0; y < HEIGHT; y++) {
        for (x = 0; x < WIDTH; x++) {
            double sum = 0.0;

            for (k = 0; k < 16; k++) {
                double dx = (x - 0.5 * (WIDTH - 1) + (k % 4 - 1.5) / 4.0) / PER_M - middle[0];
                double dy = -(y - 0.5 * (HEIGHT - 1) + (k / 4 - 1.5) / 4.0) / PER_M - middle[1];
                double ahead = (up[0] * dx + up[1] * dy) / CELL_M;
                double left = (up[0] * dy - up[1] * dx) / CELL_M;
                int white = is_white(tag, 0, (int)floor(2.0 - ahead), (int)floor(2.0 - left));

                sum += dx * dx + dy * dy > 0.035 * 0.035 ? 110.0 : white ? 200.0 : 30.0;
            }
            pixels[y * WIDTH + x] = (uint8_t)(sum / 16.0 + 0.5);
        }
    }
}

static void check_pose(const struct vs_marker *marker, int tag, double c, double s)
{
    CHECK((int)marker->tag == tag);
    CHECK(fabs(marker->x_m) < 2e-4 && fabs(marker->y_m) < 2e-4); /* drawn to a quarter px */
    CHECK(marker->ahead_x * c + marker->ahead_y * s > 0.9999);
    CHECK(fabs(marker->x_px - 0.5 * (WIDTH - 1)) < 0.2);
}

static void test_a_square_is_found_and_followed_with_its_heading(void)
{
    static const double turn[5][2] = {{1, 0}, {0, 1}, {-0.8, -0.6}, {0.28, -0.96}, {0.6, -0.8}};
    static const struct vs_window everything = {0, 0, WIDTH, HEIGHT};
    static uint8_t pixels[WIDTH * HEIGHT];
    struct vs_markers *work = malloc(vs_markers_size(WIDTH, HEIGHT));
    struct vs_outline outline;
    struct vs_search search;
    struct vs_view view;
    int k;

    CHECK(work != NULL);
    make_outline(&outline);
    make_view(&view, pixels);
    make_search(&search);
    for (k = 0; k < 5; k++) {
        struct vs_marker found[2];
        uint32_t origin[2];
        size_t count = 0;

        draw(pixels, k % TAGS, turn[k][0], turn[k][1]);
        CHECK(vs_markers_search(work, &search, &outline, &view, &everything, found, 2, &count) ==
              VS_OK);
        CHECK(count == 1);
        check_pose(&found[0], k % TAGS, turn[k][0], turn[k][1]);
        found[0].x_m += 0.002;
        CHECK(vs_markers_follow(&outline, &outline, &view, found, origin, &count) == VS_OK);
        CHECK(count == 1);
        check_pose(&found[0], k % TAGS, turn[k][0], turn[k][1]);
    }
    free(work);
}

#ifdef VS_TEST_THREADS
/* What the tracker's threads share; each has its own working memory. */
static struct vs_outline shared_outline;
static struct vs_search shared_search;
static struct vs_view shared_view;

static void *search_often(void *unused)
{
    static const struct vs_window everything = {0, 0, WIDTH, HEIGHT};
    struct vs_markers *work = malloc(vs_markers_size(WIDTH, HEIGHT));
    struct vs_marker found[2];
    uint32_t origin[2];
    int k;

    CHECK(work != NULL && unused == NULL);
    for (k = 0; k < 100; k++) {
        size_t count = 0;

        CHECK(vs_markers_search(work, &shared_search, &shared_outline, &shared_view, &everything,
                                found, 2, &count) == VS_OK && count == 1);
        check_pose(&found[0], 1, 0.6, -0.8);
        CHECK(vs_markers_follow(&shared_outline, &shared_outline, &shared_view, found, origin,
                                &count) == VS_OK && count == 1);
    }
    free(work);
    return NULL;
}

static void test_threads_share_all_but_their_memory(void)
{
    static uint8_t pixels[WIDTH * HEIGHT];
    pthread_t thread[2];
    int k;

    make_outline(&shared_outline);
    make_view(&shared_view, pixels);
    make_search(&shared_search);
    shared_search.again[0].level_256 = 128;
    draw(pixels, 1, 0.6, -0.8);
    for (k = 0; k < 2; k++)
        CHECK(pthread_create(&thread[k], NULL, search_often, NULL) == 0);
    for (k = 0; k < 2; k++)
        CHECK(pthread_join(thread[k], NULL) == 0);
}
#endif

int main(void)
{
    make_words();
    test_every_word_is_read_in_every_turn();
    test_the_white_around_may_be_covered();
    test_wrong_cells_are_not_believed();
    test_any_cells_do_no_harm();
    test_a_square_is_found_and_followed_with_its_heading();
#ifdef VS_TEST_THREADS
    test_threads_share_all_but_their_memory();
#endif
    return 0;
}
