/* SPDX-License-Identifier: MIT */
#include "vs_rays.h"

#include <math.h>
#include <string.h>

#include "vs_line.h"
#include "vs_math.h"

#define SLACK_M 1e-9      /* bodies reach this far into the next cell: more than rounding does */
#define CELLS_PER_BODY 2  /* measured: fewer bodies per cell cost more steps than they save */
#define MAX_SIDE 1024     /* cells along the grid's longer side, about */

/* Which cells a body may reach. */
struct span {
    int32_t left, right, near, far;
};

static int is_there(const struct vs_obstacle *body)
{
    return body->z_high_m >= body->z_low_m;
}

/* How far a cylinder reaches from its middle, its nose included. */
static double around(const struct vs_obstacle *body)
{
    return vs_most(body->radius_m, body->half_y_m > 0.0 ? body->half_x_m + body->half_y_m : 0.0);
}

/* How far a body reaches along x and y from its middle. */
static void reach(const struct vs_obstacle *body, double *x_m, double *y_m)
{
    double cosine = fabs(body->cosine), sine = fabs(body->sine);

    *x_m = *y_m = around(body);
    if (body->radius_m > 0.0)
        return;
    *x_m = cosine * body->half_x_m + sine * body->half_y_m;
    *y_m = sine * body->half_x_m + cosine * body->half_y_m;
}

static int is_body(const struct vs_obstacle *body)
{
    double limit = VS_OBSTACLES_LIMIT_M;

    return vs_is_within(body->x_m, -limit, limit) && vs_is_within(body->y_m, -limit, limit) &&
           vs_is_within(body->z_low_m, -limit, limit) &&
           vs_is_within(body->z_high_m, -limit, limit) &&
           vs_is_within(body->radius_m, 0.0, limit) &&
           vs_is_within(body->half_x_m, 0.0, limit) &&
           vs_is_within(body->half_y_m, 0.0, limit) && vs_is_within(body->cosine, -1.0, 1.0) &&
           vs_is_within(body->sine, -1.0, 1.0);
}

int32_t vs_line_cell(const struct vs_obstacles *s, double from_corner_m, int32_t cells)
{
    return (int32_t)vs_least(vs_most(from_corner_m / s->cell_m, 0.0), cells - 1);
}

static struct span span_of(const struct vs_obstacles *s, const struct vs_obstacle *body)
{
    struct span span;
    double x_m, y_m;

    reach(body, &x_m, &y_m);
    x_m += SLACK_M;
    y_m += SLACK_M;
    span.left = vs_line_cell(s, body->x_m - x_m - s->left_m, s->columns);
    span.right = vs_line_cell(s, body->x_m + x_m - s->left_m, s->columns);
    span.near = vs_line_cell(s, body->y_m - y_m - s->near_m, s->rows);
    span.far = vs_line_cell(s, body->y_m + y_m - s->near_m, s->rows);
    return span;
}

/* Whether a turned box and a cell of its span overlap, by the box's own axes. */
static int overlap(const struct vs_obstacles *s, const struct vs_obstacle *body,
                   int32_t column, int32_t row)
{
    double x_m = s->left_m + (column + 0.5) * s->cell_m - body->x_m;
    double y_m = s->near_m + (row + 0.5) * s->cell_m - body->y_m;
    double half_m = 0.5 * s->cell_m * (fabs(body->cosine) + fabs(body->sine)) + SLACK_M;

    if (body->radius_m > 0.0)
        return 1;
    return fabs(x_m * body->cosine + y_m * body->sine) <= body->half_x_m + half_m &&
           fabs(y_m * body->cosine - x_m * body->sine) <= body->half_y_m + half_m;
}

/* Whether a body comes within reach_m of a place; the corners of a box count as more than round. */
static int is_within(const struct vs_obstacle *body, double x_m, double y_m, double reach_m)
{
    double east_m = x_m - body->x_m, north_m = y_m - body->y_m;
    double near_m = around(body) + reach_m;

    if (body->radius_m > 0.0)
        return east_m * east_m + north_m * north_m <= near_m * near_m;
    return fabs(east_m * body->cosine + north_m * body->sine) <= body->half_x_m + reach_m &&
           fabs(north_m * body->cosine - east_m * body->sine) <= body->half_y_m + reach_m;
}

int vs_line_near(const struct vs_obstacles *s, double x_m, double y_m, double reach_m,
                 int32_t skip)
{
    double limit = VS_OBSTACLES_LIMIT_M;
    int32_t row, column, rows[2], columns[2];
    uint32_t i;

    if (!vs_is_within(x_m, -limit, limit) || !vs_is_within(y_m, -limit, limit))
        return VS_ERR_ARGUMENT;
    if (s->columns == 0)
        return 0;
    columns[0] = vs_line_cell(s, x_m - reach_m - s->left_m, s->columns);
    columns[1] = vs_line_cell(s, x_m + reach_m - s->left_m, s->columns);
    rows[0] = vs_line_cell(s, y_m - reach_m - s->near_m, s->rows);
    rows[1] = vs_line_cell(s, y_m + reach_m - s->near_m, s->rows);
    for (row = rows[0]; row <= rows[1]; row++)
        for (column = columns[0]; column <= columns[1]; column++) {
            const uint32_t *first = s->first + row * s->columns + column;

            for (i = first[0]; i < first[1]; i++)
                if ((int32_t)s->inside[i] != skip &&
                    is_within(&s->bodies[s->inside[i]], x_m, y_m, reach_m))
                    return 1;
        }
    return 0;
}

/*
 * Counts the cells of one body. With first, each cell's count grows; with inside too, first
 * holds where each cell's part of inside ends, and the body is noted before that.
 */
static uint32_t spread(const struct vs_obstacles *s, uint32_t number, uint32_t *first,
                       uint32_t *inside)
{
    const struct vs_obstacle *body = &s->bodies[number];
    struct span span;
    int32_t row, column;
    uint32_t cells = 0;

    if (!is_there(body))
        return 0;
    span = span_of(s, body);
    for (row = span.near; row <= span.far; row++) {
        for (column = span.left; column <= span.right; column++) {
            int32_t cell = row * s->columns + column;

            if (!overlap(s, body, column, row))
                continue;
            cells++;
            if (inside)
                inside[--first[cell]] = number;
            else if (first)
                first[cell]++;
        }
    }
    return cells;
}

/* Finds the bodies' bounds and lays the cells over them. */
static void lay(struct vs_obstacles *s)
{
    double x_m, y_m, width_m, depth_m, right_m = -INFINITY, far_m = -INFINITY;
    uint32_t i, there = 0;

    s->left_m = s->near_m = s->low_m = INFINITY;
    s->high_m = -INFINITY;
    for (i = 0; i < s->count; i++) {
        const struct vs_obstacle *body = &s->bodies[i];

        if (!is_there(body))
            continue;
        reach(body, &x_m, &y_m);
        s->left_m = vs_least(s->left_m, body->x_m - x_m - SLACK_M);
        s->near_m = vs_least(s->near_m, body->y_m - y_m - SLACK_M);
        right_m = vs_most(right_m, body->x_m + x_m + SLACK_M);
        far_m = vs_most(far_m, body->y_m + y_m + SLACK_M);
        s->low_m = vs_least(s->low_m, body->z_low_m);
        s->high_m = vs_most(s->high_m, body->z_high_m);
        there++;
    }
    s->columns = s->rows = 0;
    s->cell_m = 1.0;
    if (there == 0)
        return;
    width_m = right_m - s->left_m;
    depth_m = far_m - s->near_m;
    s->cell_m = vs_root(width_m * depth_m / (CELLS_PER_BODY * there));
    s->cell_m = vs_most(s->cell_m, vs_most(width_m, depth_m) / MAX_SIDE);
    s->columns = (int32_t)(width_m / s->cell_m) + 1;
    s->rows = (int32_t)(depth_m / s->cell_m) + 1;
}

int vs_obstacles_plan(struct vs_obstacles *s)
{
    uint32_t i;

    for (i = 0; i < s->count; i++)
        if (!is_body(&s->bodies[i]))
            return VS_ERR_ARGUMENT;
    lay(s);
    s->words = (uint32_t)(s->columns * s->rows) + 1;
    for (i = 0; i < s->count; i++)
        s->words += spread(s, i, NULL, NULL);
    return VS_OK;
}

void vs_obstacles_sort(struct vs_obstacles *s, uint32_t *memory)
{
    uint32_t cells = (uint32_t)(s->columns * s->rows);
    uint32_t *first = memory, *inside = memory + cells + 1;
    uint32_t i;

    memset(first, 0, (cells + 1) * sizeof *first);
    for (i = 0; i < s->count; i++)
        spread(s, i, first, NULL);
    for (i = 1; i <= cells; i++)
        first[i] += first[i - 1];
    for (i = s->count; i > 0; i--)
        spread(s, i - 1, first, inside);
    s->first = first;
    s->inside = inside;
}
