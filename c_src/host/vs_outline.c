/* SPDX-License-Identifier: MIT */
#include "vs_outline.h"

#include <string.h>

#include "vs_edges.h"
#include "vs_math.h"

#define SPREAD 0.02   /* of the reach: the least spread of offsets that is believed */
#define BORDER_PX 2.0 /* a marker nearer to the picture's border is not reported */

int vs_outline_check(const struct vs_outline *outline)
{
    int i;

    if (outline->samples < 8 || outline->samples > VS_OUTLINE_SAMPLES ||
        outline->cells < 0 || outline->cells > VS_OUTLINE_CELLS ||
        outline->rims < 0 || outline->rims > VS_OUTLINE_RIM ||
        outline->passes < 1 || outline->passes > VS_OUTLINE_PASSES || !(outline->unit_m > 0.0))
        return VS_ERR_ARGUMENT;
    for (i = 0; i < outline->passes; i++) {
        const struct vs_outline_pass *pass = &outline->stage[i];

        if (pass->steps < 4 || pass->steps > VS_OUTLINE_STEPS || pass->stride < 1 ||
            pass->stride > outline->samples / 8 || !(pass->reach_m > 0.0))
            return VS_ERR_ARGUMENT;
    }
    return VS_OK;
}

/* The four unknowns' share in a sample's offset: shift ahead, shift left, turn, growth. */
static void design(const struct vs_outline *outline, int sample, double row[4])
{
    double nx = outline->normal_x[sample], ny = outline->normal_y[sample];
    double x = outline->x_m[sample], y = outline->y_m[sample];

    row[0] = nx;
    row[1] = ny;
    row[2] = ny * x - nx * y;
    row[3] = nx * x + ny * y;
}

/* Solves a symmetric positive system in place, by Gauss; the answer is in right. */
static void solve(double normal[4][4], double right[4])
{
    int i, j, k;

    for (i = 0; i < 4; i++) {
        double pivot = 1.0 / normal[i][i];

        for (j = i + 1; j < 4; j++) {
            double factor = normal[j][i] * pivot;

            for (k = i + 1; k < 4; k++)
                normal[j][k] -= factor * normal[i][k];
            right[j] -= factor * right[i];
        }
    }
    for (i = 3; i >= 0; i--) {
        for (k = i + 1; k < 4; k++)
            right[i] -= normal[i][k] * right[k];
        right[i] /= normal[i][i];
    }
}

/* The move that brings the outline to its edges; edges far from the others weigh less. */
static void find_move(const struct vs_outline *outline, const struct vs_profiles *p,
                      const struct vs_edges *e, double reach_m, double move[4])
{
    double normal[4][4], row[4];
    float far[VS_OUTLINE_SAMPLES];
    double spread_m;
    int i, j, k;

    for (i = 0; i < p->count; i++)
        far[i] = e->offset_m[i] < 0.0F ? -e->offset_m[i] : e->offset_m[i];
    spread_m = 2.0 * ((double)vs_edges_middle(far, p->count) + SPREAD * reach_m);
    memset(normal, 0, sizeof normal);
    for (j = 0; j < 4; j++) {
        normal[j][j] = 1e-9;
        move[j] = 0.0;
    }
    for (i = 0; i < p->count; i++) {
        double offset_m = (double)e->offset_m[i];
        double weight = e->found[i] / (1.0 + offset_m * offset_m / (spread_m * spread_m));

        design(outline, p->sample[i], row);
        for (j = 0; j < 4; j++) {
            for (k = 0; k < 4; k++)
                normal[j][k] += weight * row[j] * row[k];
            move[j] += weight * row[j] * offset_m;
        }
    }
    solve(normal, move);
}

static double within(double value, double limit)
{
    return value > limit ? limit : value < -limit ? -limit : value;
}

static void apply_move(struct vs_marker *m, double reach_m, const double move[4])
{
    double ahead_m = within(move[0], reach_m), left_m = within(move[1], reach_m);
    double turn = within(move[2], 0.3) / m->scale;
    double c = m->ahead_x, s = m->ahead_y, length;

    m->x_m += c * ahead_m - s * left_m;
    m->y_m += s * ahead_m + c * left_m;
    length = vs_root(1.0 + turn * turn);
    m->ahead_x = (c - s * turn) / length;
    m->ahead_y = (s + c * turn) / length;
    m->scale += within(move[3], 0.2);
}

/* How well the outline fits after the move. */
static void judge(const struct vs_outline *outline, const struct vs_profiles *p,
                  const struct vs_edges *e, const struct vs_outline_pass *pass,
                  const double move[4], struct vs_marker *marker)
{
    double sum = 0.0, row[4];
    int found = 0;
    int i;

    for (i = 0; i < p->count; i++) {
        double left_m;

        if (!e->found[i])
            continue;
        design(outline, p->sample[i], row);
        left_m = (double)e->offset_m[i] - row[0] * move[0] - row[1] * move[1] -
                 row[2] * move[2] - row[3] * move[3];
        sum += left_m * left_m;
        found++;
    }
    marker->coverage = (double)found * pass->stride / outline->samples;
    marker->residual_m = found > 0 ? vs_root(sum / found) : pass->reach_m;
}

/* Moves the outline once to where its edges are; 0 if this is no marker. */
static int fit_once(const struct vs_outline *outline, const struct vs_view *view,
                    const struct vs_outline_pass *pass, struct vs_marker *marker)
{
    struct vs_profiles p;
    struct vs_edges e;
    double contrast, move[4];

    if (vs_edges_take(outline, view, marker, pass, &p) != VS_OK ||
        p.count * pass->stride < outline->samples * pass->least_coverage || p.count < 8)
        return 0;
    vs_edges_shades(&p, pass->steps, marker);
    contrast = marker->white - marker->black;
    if (!(contrast > outline->least_contrast))
        return 0;
    vs_edges_find(&p, pass, outline->unit_m, contrast, &e);
    find_move(outline, &p, &e, pass->reach_m, move);
    judge(outline, &p, &e, pass, move, marker);
    if (pass == &outline->stage[outline->passes - 1])
        vs_edges_sharpness(outline, &p, &e, pass, marker);
    apply_move(marker, pass->reach_m, move);
    return marker->coverage >= pass->least_coverage &&
           marker->residual_m < pass->most_residual_m &&
           marker->scale > 1.0 - outline->scale_doubt &&
           marker->scale < 1.0 + outline->scale_doubt;
}

/* Tells whether the marker is wholly in the picture. */
static int is_whole(const struct vs_outline *outline, const struct vs_view *view,
                    const struct vs_marker *marker)
{
    double pixel[2];
    int i;

    for (i = 0; i < outline->rims; i++) {
        if (vs_edges_see(view, marker, outline->rim_x_m[i], outline->rim_y_m[i], pixel) !=
                VS_OK ||
            !vs_edges_inside(&view->picture, pixel[0], pixel[1], BORDER_PX - 0.5))
            return 0;
    }
    return 1;
}

int vs_outline_fit(const struct vs_outline *outline, const struct vs_view *view,
                   struct vs_marker *marker)
{
    int i;

    for (i = 0; i < outline->passes; i++) {
        if (!fit_once(outline, view, &outline->stage[i], marker))
            return 0;
    }
    return is_whole(outline, view, marker);
}

void vs_outline_read(const struct vs_outline *outline, const struct vs_view *view,
                     struct vs_marker *marker)
{
    double contrast = marker->white - marker->black;
    double pixel[2], ahead[2], left[2];
    int i, k;

    memset(marker->cell, 0, sizeof marker->cell);
    if (vs_edges_see(view, marker, 0.0, 0.0, pixel) != VS_OK ||
        vs_edges_slopes(view, marker, ahead, left) != VS_OK)
        return;
    marker->x_px = pixel[0];
    marker->y_px = pixel[1];
    for (i = 0; i < outline->cells; i++) {
        double sum = 0.0;

        for (k = 0; k < VS_OUTLINE_SPOTS; k++) {
            double x_m = marker->scale * outline->spot_x_m[i * VS_OUTLINE_SPOTS + k];
            double y_m = marker->scale * outline->spot_y_m[i * VS_OUTLINE_SPOTS + k];

            sum += vs_edges_look(&view->picture, pixel[0] + x_m * ahead[0] + y_m * left[0],
                                 pixel[1] + x_m * ahead[1] + y_m * left[1]);
        }
        marker->cell[i] = (sum / VS_OUTLINE_SPOTS - marker->black) / contrast;
    }
}
