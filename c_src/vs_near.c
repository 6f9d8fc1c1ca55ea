/* SPDX-License-Identifier: MIT */
#include "vs_near.h"

#include "vs_lens.h"

#define REACH_M 0.11 /* farthest thing a robot can feel from its centre: ring and infrared */
#define SKIN_M 0.02  /* extra reach of the pairs: they hold until somebody moved half of it */
#define MOVED_M (SKIN_M / 2.0 / 1.4142135623730951) /* along one axis */

/* 1 if somebody has moved so far that a pair may be missing. */
static int is_due(const struct vs_near *near, const double *positions_m, uint32_t stride)
{
    uint32_t b;

    for (b = 0; b < near->bodies && near->searches > 0; b++) {
        double x = positions_m[b * stride] - near->searched_m[2 * b];
        double y = positions_m[b * stride + 1] - near->searched_m[2 * b + 1];

        if (!(x > -MOVED_M && x < MOVED_M && y > -MOVED_M && y < MOVED_M))
            return 1;
    }
    return near->searches == 0;
}

static void add(struct vs_near *near, uint32_t robot, uint32_t other)
{
    near->pairs[near->count].robot = robot;
    near->pairs[near->count].other = other;
    near->count++;
}

static void search_bodies(struct vs_near *near, uint32_t robot)
{
    const double *at = near->searched_m;
    uint32_t b;

    for (b = 0; b < near->bodies; b++) {
        double reach_m = REACH_M + SKIN_M + near->radii_m[b];
        double x = at[2 * b] - at[2 * robot];
        double y = at[2 * b + 1] - at[2 * robot + 1];

        if (x * x + y * y < reach_m * reach_m && b != robot)
            add(near, robot, b);
    }
}

static void search_boxes(struct vs_near *near, uint32_t robot)
{
    const double *at = near->searched_m + 2 * robot;
    double normal[2];
    uint32_t b;

    for (b = 0; b < near->boxes; b++) {
        const double *row = near->box_rows + VS_BOX_NUMBERS * b;

        if (vs_box_gap(row, at[0], at[1], normal) < REACH_M + SKIN_M / 2.0)
            add(near, robot, near->bodies + b);
    }
}

void vs_near_update(struct vs_near *near, const double *positions_m, uint32_t stride)
{
    uint32_t b;

    if (!is_due(near, positions_m, stride))
        return;
    near->searches++;
    near->count = 0;
    for (b = 0; b < near->bodies; b++) {
        near->searched_m[2 * b] = positions_m[b * stride];
        near->searched_m[2 * b + 1] = positions_m[b * stride + 1];
    }
    for (b = 0; b < near->robots; b++) {
        search_bodies(near, b);
        search_boxes(near, b);
    }
}

/* Outside: along the way from the nearest point of the outline. */
static double outside_gap(double out[2])
{
    double gap = vs_root(out[0] * out[0] + out[1] * out[1]);

    out[0] /= gap;
    out[1] /= gap;
    return gap;
}

double vs_box_gap(const double *box_row, double x_m, double y_m, double normal[2])
{
    double east = x_m - box_row[0];
    double north = y_m - box_row[1];
    double cosine = box_row[2];
    double sine = box_row[3];
    double along = east * cosine + north * sine;
    double aside = north * cosine - east * sine;
    double beyond_x = (along < 0.0 ? -along : along) - box_row[4];
    double beyond_y = (aside < 0.0 ? -aside : aside) - box_row[5];
    double way[2];
    double gap;

    way[0] = beyond_x > 0.0 ? beyond_x : 0.0;
    way[1] = beyond_y > 0.0 ? beyond_y : 0.0;
    if (way[0] + way[1] > 1e-150) {
        gap = outside_gap(way);
    } else {
        /* Inside the shortest way out leads through the nearest side. */
        way[0] = beyond_x > beyond_y ? 1.0 : 0.0;
        way[1] = 1.0 - way[0];
        gap = beyond_x > beyond_y ? beyond_x : beyond_y;
    }
    way[0] = along < 0.0 ? -way[0] : way[0];
    way[1] = aside < 0.0 ? -way[1] : way[1];
    normal[0] = way[0] * cosine - way[1] * sine;
    normal[1] = way[0] * sine + way[1] * cosine;
    return gap;
}

void vs_box_gaps(const double *box_rows, const uint32_t *box, const double *points_m,
                 uint32_t n, double *gaps_m, double *normals)
{
    uint32_t i;

    for (i = 0; i < n; i++)
        gaps_m[i] = vs_box_gap(box_rows + VS_BOX_NUMBERS * box[i], points_m[2 * i],
                               points_m[2 * i + 1], normals + 2 * i);
}
