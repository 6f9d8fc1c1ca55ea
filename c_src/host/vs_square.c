/* SPDX-License-Identifier: MIT */
#include "vs_square.h"

#include <string.h>

#include "vs_edges.h"
#include "vs_words.h"

#define SPOTS 3        /* grey values read in each cell, along and across */
#define SPOT_APART 0.2 /* [cell] */

/* What reads as badly and has such crooked sides is no marker, see squares.py. */
#define CLEARER 3.2   /* least margin beyond 1, in errors */
#define CROOKED 0.008 /* [side] */
#define SHORT 4       /* cells a side */

/* Reads the grey values of a fitted square's cells; 0 if it is not in front of the camera. */
static int sample_cells(const struct vs_words *words, const struct vs_view *view,
                        const struct vs_marker *marker, float *cells)
{
    int span = words->cells + 4, side = SPOTS * span, row, column, i;
    double half_m = 0.5 * span * words->cell_m * marker->scale;
    double corner[4][2], place[SPOTS * VS_WORDS_SPAN];
    float grey[SPOTS * VS_WORDS_SPAN * SPOTS * VS_WORDS_SPAN];

    for (i = 0; i < 4; i++) {
        if (vs_edges_see(view, marker, i < 2 ? half_m : -half_m,
                         i % 2 == 0 ? half_m : -half_m, corner[i]) != VS_OK)
            return 0;
    }
    for (i = 0; i < side; i++)
        place[i] = (i / SPOTS + 0.5 + SPOT_APART * (i % SPOTS - 1)) / span;
    vs_edges_grid(&view->picture, (const double(*)[2])corner, place, side, grey);
    memset(cells, 0, (size_t)(span * span) * sizeof cells[0]);
    for (row = 0; row < side; row++) {
        for (column = 0; column < side; column++)
            cells[row / SPOTS * span + column / SPOTS] += grey[row * side + column];
    }
    return 1;
}

/* Makes another side the one ahead, by quarter turns counter-clockwise. */
static void turn_quarters(struct vs_marker *marker, int turns)
{
    int i;

    for (i = 0; i < turns; i++) {
        double ahead = marker->ahead_x, sharp = marker->sharp_ahead;

        marker->ahead_x = -marker->ahead_y;
        marker->ahead_y = ahead;
        marker->sharp_ahead = marker->sharp_left;
        marker->sharp_left = sharp;
    }
}

static void turn_by(struct vs_marker *marker, double c, double s)
{
    double x = marker->ahead_x, y = marker->ahead_y;

    marker->ahead_x = c * x - s * y;
    marker->ahead_y = s * x + c * y;
}

/* Shifts a marker in its own frame. */
static void shift_by(struct vs_marker *marker, double ahead_m, double left_m)
{
    marker->x_m += marker->scale * (marker->ahead_x * ahead_m - marker->ahead_y * left_m);
    marker->y_m += marker->scale * (marker->ahead_y * ahead_m + marker->ahead_x * left_m);
}

/* Whether a square is black on white with a word in it, but hardly. */
static int is_doubtful(const struct vs_words *words, const struct vs_marker *marker)
{
    double side_m = (words->cells + 2) * words->cell_m * marker->scale;

    return words->cells <= SHORT && marker->margin < 1.0 + CLEARER * marker->error &&
           marker->residual_m > CROOKED * side_m;
}

void vs_square_name(const struct vs_words *words, const struct vs_view *view,
                   struct vs_marker *marker)
{
    float cells[VS_WORDS_SPAN * VS_WORDS_SPAN];
    struct vs_reading reading;
    int32_t level[2];

    level[0] = vs_edges_level(words->sharp, VS_WORDS_BLURS, marker->sharp_left);
    level[1] = vs_edges_level(words->sharp, VS_WORDS_BLURS, marker->sharp_ahead);
    reading.tag = -1;
    reading.turn = reading.sure = 0;
    reading.error = reading.margin = 1.0;
    if (sample_cells(words, view, marker, cells))
        vs_words_read(words, cells, level, 1, &reading);
    marker->error = reading.error;
    marker->margin = reading.margin;
    marker->guess = reading.tag;
    if (reading.sure && !is_doubtful(words, marker))
        marker->tag = reading.tag;
    turn_quarters(marker, reading.turn);
    turn_by(marker, words->turn_x, words->turn_y);
    shift_by(marker, words->centre_x_m, words->centre_y_m);
}

void vs_square_upright(const struct vs_words *words, struct vs_marker *marker)
{
    shift_by(marker, -words->centre_x_m, -words->centre_y_m);
    turn_by(marker, words->turn_x, -words->turn_y);
}
