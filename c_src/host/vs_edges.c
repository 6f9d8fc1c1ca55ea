/* SPDX-License-Identifier: MIT */
#include "vs_edges.h"

#include "vs_lens.h"

#define FLAT 0.35      /* of the contrast per unit: what rises less is no part of an edge */
#define RISE 0.4       /* of the contrast: an edge rises at least by this */
#define INSIDE_PX 0.05 /* what rounding between two pixels of a picture stays within */
#define FIXED 65536.0  /* places in pictures are integers in 1/65536 px */
#define SHARP_U 0.25   /* to both sides of an edge: how sharp it is */
#define NEAR_M 1e-3    /* distance over which the camera's map counts as straight */

int vs_edges_see(const struct vs_view *view, const struct vs_marker *marker, double x_m,
                 double y_m, double pixel[2])
{
    double point_m[3];

    point_m[0] = marker->x_m + marker->ahead_x * x_m - marker->ahead_y * y_m;
    point_m[1] = marker->y_m + marker->ahead_y * x_m + marker->ahead_x * y_m;
    point_m[2] = view->height_m;
    return vs_lens_project(&view->lens, point_m, pixel);
}

int vs_edges_inside(const struct vs_picture *picture, double x_px, double y_px,
                    double border_px)
{
    return x_px >= border_px && y_px >= border_px &&
           x_px < picture->width_px - 1 - border_px &&
           y_px < picture->height_px - 1 - border_px;
}

int vs_edges_slopes(const struct vs_view *view, const struct vs_marker *marker,
                    double ahead_px[2], double left_px[2])
{
    double front[2], back[2], left[2], right[2];
    int i;

    if (vs_edges_see(view, marker, NEAR_M, 0.0, front) != VS_OK ||
        vs_edges_see(view, marker, -NEAR_M, 0.0, back) != VS_OK ||
        vs_edges_see(view, marker, 0.0, NEAR_M, left) != VS_OK ||
        vs_edges_see(view, marker, 0.0, -NEAR_M, right) != VS_OK)
        return VS_ERR_ARGUMENT;
    for (i = 0; i < 2; i++) {
        ahead_px[i] = (front[i] - back[i]) / (2.0 * NEAR_M);
        left_px[i] = (left[i] - right[i]) / (2.0 * NEAR_M);
    }
    return VS_OK;
}

/* The grey value between four pixels, none of them outside of the picture, times 65536. */
static int32_t look(const struct vs_picture *picture, int32_t x, int32_t y)
{
    const uint8_t *p = picture->pixels + (size_t)(y >> 16) * picture->stride + (x >> 16);
    const uint8_t *q = p + picture->stride;
    int32_t right = x >> 8 & 255, down = y >> 8 & 255;
    int32_t above = p[0] * 256 + right * (p[1] - p[0]);
    int32_t below = q[0] * 256 + right * (q[1] - q[0]);

    return above * 256 + down * (below - above);
}

double vs_edges_look(const struct vs_picture *picture, double x_px, double y_px)
{
    if (!vs_edges_inside(picture, x_px, y_px, INSIDE_PX))
        return 0.0;
    return look(picture, (int32_t)(x_px * FIXED), (int32_t)(y_px * FIXED)) / FIXED;
}

void vs_edges_grid(const struct vs_picture *picture, const double corner_px[4][2],
                   const double *place, int side, float *grey)
{
    int row, column, i, is_inside = 1;

    for (i = 0; i < 4; i++)
        is_inside &= vs_edges_inside(picture, corner_px[i][0], corner_px[i][1], INSIDE_PX);
    for (row = 0; row < side; row++) {
        double from[2], to[2];

        for (i = 0; i < 2; i++) {
            from[i] = corner_px[0][i] + place[row] * (corner_px[2][i] - corner_px[0][i]);
            to[i] = corner_px[1][i] + place[row] * (corner_px[3][i] - corner_px[1][i]) - from[i];
        }
        for (column = 0; column < side; column++) {
            double x_px = from[0] + place[column] * to[0];
            double y_px = from[1] + place[column] * to[1];

            *grey++ = is_inside ? (float)(look(picture, (int32_t)(x_px * FIXED),
                                               (int32_t)(y_px * FIXED)) / FIXED)
                                : (float)vs_edges_look(picture, x_px, y_px);
        }
    }
}

int vs_edges_take(const struct vs_outline *outline, const struct vs_view *view,
                  const struct vs_marker *marker, const struct vs_outline_pass *pass,
                  struct vs_profiles *p)
{
    const struct vs_picture *picture = &view->picture;
    double ahead[2], left[2], begin[2];
    int i, k;

    p->count = 0;
    if (vs_edges_slopes(view, marker, ahead, left) != VS_OK)
        return VS_ERR_ARGUMENT;
    for (i = 0; i < outline->samples; i += pass->stride) {
        double nx = pass->reach_m * outline->normal_x[i];
        double ny = pass->reach_m * outline->normal_y[i];
        double across_x = nx * ahead[0] + ny * left[0];
        double across_y = nx * ahead[1] + ny * left[1];
        int32_t x, y, step_x, step_y;

        if (vs_edges_see(view, marker, marker->scale * outline->x_m[i],
                         marker->scale * outline->y_m[i], begin) != VS_OK)
            continue;
        begin[0] -= across_x;
        begin[1] -= across_y;
        if (!vs_edges_inside(picture, begin[0], begin[1], INSIDE_PX) ||
            !vs_edges_inside(picture, begin[0] + 2.0 * across_x, begin[1] + 2.0 * across_y,
                             INSIDE_PX))
            continue;
        x = (int32_t)(begin[0] * FIXED);
        y = (int32_t)(begin[1] * FIXED);
        step_x = (int32_t)(2.0 * across_x * FIXED / (pass->steps - 1));
        step_y = (int32_t)(2.0 * across_y * FIXED / (pass->steps - 1));
        for (k = 0; k < pass->steps; k++, x += step_x, y += step_y)
            p->grey[p->count][k] = (float)look(picture, x, y) * (float)(1.0 / FIXED);
        p->sample[p->count++] = i;
    }
    return VS_OK;
}

/* Puts those of v[low .. end - 1] below the limit, or at it, first; returns where they end. */
static inline int put_first(float *v, int low, int end, float limit, int is_at)
{
    int i;

    for (i = low; i < end; i++) {
        float one = v[i];
        int is_first = (one < limit) | ((one == limit) & is_at);

        v[i] = v[low];
        v[low] = one;
        low += is_first;
    }
    return low;
}

/* The middle one of three; no branch, as a processor cannot foresee which it is. */
static float middle_of(float a, float b, float c)
{
    float low = a < b ? a : b, high = a < b ? b : a;

    high = c < high ? c : high;
    return low < high ? high : low;
}

float vs_edges_middle(float *v, int count)
{
    int low = 0, end = count, k = count / 2;

    for (;;) {
        float pivot = middle_of(v[low], v[low + (end - low) / 2], v[end - 1]);
        int below = put_first(v, low, end, pivot, 0);

        if (k < below) {
            end = below;
            continue;
        }
        low = put_first(v, below, end, pivot, 1);
        if (k < low || low == below) /* what is no number is nowhere */
            return pivot;
    }
}

void vs_edges_shades(const struct vs_profiles *p, int steps, struct vs_marker *marker)
{
    float inner[VS_OUTLINE_SAMPLES], outer[VS_OUTLINE_SAMPLES];
    int i;

    for (i = 0; i < p->count; i++) {
        const float *grey = p->grey[i];

        inner[i] = grey[0] < grey[1] ? grey[0] : grey[1];
        outer[i] = grey[steps - 1] > grey[steps - 2] ? grey[steps - 1] : grey[steps - 2];
    }
    marker->black = (double)vs_edges_middle(inner, p->count);
    marker->white = (double)vs_edges_middle(outer, p->count);
}

void vs_edges_find(const struct vs_profiles *p, const struct vs_outline_pass *pass,
                   double unit_m, double contrast, struct vs_edges *e)
{
    float step_m = (float)(2.0 * pass->reach_m) / (float)(pass->steps - 1);
    float flat = (float)(FLAT * contrast) * step_m / (float)unit_m;
    float first_m = 0.5F * step_m - (float)pass->reach_m;
    int i, k;

    for (i = 0; i < p->count; i++) {
        float height = 0.0F, moment = 0.0F;

        for (k = 0; k + 1 < pass->steps; k++) {
            float rise = p->grey[i][k + 1] - p->grey[i][k];

            rise = rise < flat ? 0.0F : rise;
            height += rise;
            moment += rise * (float)k;
        }
        e->found[i] = height > (float)(RISE * contrast);
        e->offset_m[i] = height > 0.0F ? first_m + step_m * moment / height : 0.0F;
    }
}

/* The grey value of a profile at a place along its normal, in steps from its begin. */
static double along(const float *grey, int steps, double place)
{
    int k = place > 0.0 ? (int)place : 0;

    k = k > steps - 2 ? steps - 2 : k;
    return (double)grey[k] + (place - k) * (double)(grey[k + 1] - grey[k]);
}

void vs_edges_sharpness(const struct vs_outline *outline, const struct vs_profiles *p,
                        const struct vs_edges *e, const struct vs_outline_pass *pass,
                        struct vs_marker *marker)
{
    double per_m = (pass->steps - 1) / (2.0 * pass->reach_m);
    double near = outline->unit_m * SHARP_U * per_m;
    double xx = 1e-9, xy = 0.0, yy = 1e-9, x = 0.0, y = 0.0;
    double contrast = marker->white - marker->black;
    int i;

    for (i = 0; i < p->count; i++) {
        double nx = outline->normal_x[p->sample[i]], ny = outline->normal_y[p->sample[i]];
        double place = ((double)e->offset_m[i] + pass->reach_m) * per_m;
        double gain;

        if (!e->found[i] || place - near < 0.0 || place + near > pass->steps - 1)
            continue;
        gain = (along(p->grey[i], pass->steps, place + near) -
                along(p->grey[i], pass->steps, place - near)) / contrast;
        nx *= nx;
        ny *= ny;
        xx += nx * nx;
        xy += nx * ny;
        yy += ny * ny;
        x += nx * gain;
        y += ny * gain;
    }
    marker->sharp_ahead = (yy * x - xy * y) / (xx * yy - xy * xy + 1e-12);
    marker->sharp_left = (xx * y - xy * x) / (xx * yy - xy * xy + 1e-12);
}

int32_t vs_edges_level(const double *sharp, int32_t levels, double sharpness)
{
    int32_t level = 0;

    while (level + 1 < levels && sharpness < 0.5 * (sharp[level] + sharp[level + 1]))
        level++;
    return level;
}
