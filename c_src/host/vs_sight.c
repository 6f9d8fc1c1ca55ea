/* SPDX-License-Identifier: MIT */
#include "vs_rays.h"

#include <math.h>

#include "vs_line.h"
#include "vs_math.h"

#define MAX_POINTS 32  /* of a bundle */
#define RECENT 8       /* suspects that are not asked again when the next cell has them, too */
#define SLACK_M 1e-9   /* more than rounding moves a line by */

/* Points that are close together. */
struct bundle {
    size_t count;
    double middle[3];
    double radius_m;  /* seen from above */
    double height_m;  /* half of it */
};

/* The lines from a bundle to one goal. */
struct fan {
    const struct bundle *bundle;
    struct vs_line middle;              /* as if it began in the bundle's middle */
    struct vs_line lines[MAX_POINTS];
    uint8_t is_free[MAX_POINTS];
    size_t free;                        /* how many of them */
    uint32_t recent[RECENT];
    uint32_t suspects;                  /* so far */
};

/* Takes as many points, at least one, as lie at most one cell apart. */
static struct bundle gather(const double *points, size_t count, double cell_m)
{
    struct bundle bundle;
    double low[3], high[3], half[3];
    int is_near = 1;
    size_t axis, i;

    for (axis = 0; axis < 3; axis++)
        low[axis] = high[axis] = points[axis];
    for (i = 1; i < count && i < MAX_POINTS && is_near; i++) {
        double l[3], h[3];

        for (axis = 0; axis < 3; axis++) {
            l[axis] = vs_least(low[axis], points[3 * i + axis]);
            h[axis] = vs_most(high[axis], points[3 * i + axis]);
            is_near &= h[axis] - l[axis] <= cell_m;
        }
        for (axis = 0; axis < 3 && is_near; axis++) {
            low[axis] = l[axis];
            high[axis] = h[axis];
        }
    }
    bundle.count = is_near ? i : i - 1;
    for (axis = 0; axis < 3; axis++) {
        bundle.middle[axis] = 0.5 * (low[axis] + high[axis]);
        half[axis] = 0.5 * (high[axis] - low[axis]) + SLACK_M;
    }
    bundle.radius_m = vs_root(half[0] * half[0] + half[1] * half[1]);
    bundle.height_m = half[2];
    return bundle;
}

/* Whether a body comes so near to the fan's middle line that it may meet another one. */
static int is_suspect(const struct vs_obstacle *body, const struct fan *fan)
{
    struct vs_obstacle grown = *body;

    grown.z_low_m -= fan->bundle->height_m;
    grown.z_high_m += fan->bundle->height_m;
    if (body->radius_m > 0.0) {
        double around_m = body->half_y_m > 0.0 ? body->half_x_m + body->half_y_m : 0.0;

        grown.radius_m = vs_most(body->radius_m, around_m) + fan->bundle->radius_m;
        grown.half_y_m = 0.0;
    } else {
        grown.half_x_m += fan->bundle->radius_m;
        grown.half_y_m += fan->bundle->radius_m;
    }
    return vs_line_meet(&grown, &fan->middle, 1) <= 1.0;
}

static int is_recent(const struct fan *fan, uint32_t number)
{
    uint32_t i;

    for (i = 0; i < RECENT && i < fan->suspects; i++)
        if (fan->recent[i] == number)
            return 1;
    return 0;
}

/* Lets a body block what it meets of the fan. */
static void block(struct fan *fan, const struct vs_obstacle *body, uint32_t number)
{
    size_t i;

    fan->recent[fan->suspects++ % RECENT] = number;
    for (i = 0; i < fan->bundle->count; i++) {
        const struct vs_line *line = &fan->lines[i];

        if (fan->is_free[i] && line->skip[0] != (int32_t)number &&
            line->skip[1] != (int32_t)number && vs_line_meet(body, line, 1) <= 1.0) {
            fan->is_free[i] = 0;
            fan->free--;
        }
    }
}

static void ask_cell(const struct vs_obstacles *s, int32_t cell, struct fan *fan)
{
    uint32_t i;

    for (i = s->first[cell]; i < s->first[cell + 1]; i++) {
        uint32_t number = s->inside[i];

        if (!is_recent(fan, number) && is_suspect(&s->bodies[number], fan))
            block(fan, &s->bodies[number], number);
    }
}

/* The first and the last cell that a part of the fan's middle, and what is near it, touches. */
static void stretch(const struct vs_obstacles *s, const struct fan *fan, int axis,
                    const double part[2], int32_t cells[2])
{
    double corner_m = axis == 0 ? s->left_m : s->near_m;
    double a = fan->middle.start[axis] + part[0] * fan->middle.way[axis] - corner_m;
    double b = fan->middle.start[axis] + part[1] * fan->middle.way[axis] - corner_m;
    int32_t count = axis == 0 ? s->columns : s->rows;

    cells[0] = vs_line_cell(s, vs_least(a, b) - fan->bundle->radius_m, count);
    cells[1] = vs_line_cell(s, vs_most(a, b) + fan->bundle->radius_m, count);
}

/* Asks the cells along the fan, from its start, until no line is free or the fan ends. */
static void ask(const struct vs_obstacles *s, struct fan *fan)
{
    const struct vs_line *middle = &fan->middle;
    int axis = fabs(middle->way[0]) >= fabs(middle->way[1]) ? 0 : 1;
    double corner_m = axis == 0 ? s->left_m : s->near_m, radius_m = fan->bundle->radius_m;
    double height_m = fan->bundle->height_m, whole[2] = {0.0, 1.0};
    int32_t cells[2], others[2], i, k, n;

    if (s->columns == 0 || !vs_line_cut(middle, 2, s->low_m - height_m, s->high_m + height_m,
                                        &whole[0], &whole[1]))
        return;
    stretch(s, fan, axis, whole, cells);
    for (n = 0; n <= cells[1] - cells[0] && fan->free > 0; n++) {
        double part[2] = {whole[0], whole[1]}, low_m;

        i = middle->way[axis] > 0.0 ? cells[0] + n : cells[1] - n;
        low_m = corner_m + i * s->cell_m - radius_m;
        if (!vs_line_cut(middle, axis, low_m, low_m + s->cell_m + 2.0 * radius_m, &part[0],
                         &part[1]))
            continue;
        stretch(s, fan, 1 - axis, part, others);
        for (k = others[0]; k <= others[1]; k++)
            ask_cell(s, axis == 0 ? k * s->columns + i : i * s->columns + k, fan);
    }
}

int vs_sight_seen(const struct vs_obstacles *s, const double *points, size_t count,
                  const double *goals_at, size_t goals, const int32_t *skip, size_t skips,
                  uint8_t *seen)
{
    struct bundle bundle;
    struct fan fan;
    size_t begin, i, k;

    fan.bundle = &bundle;
    for (begin = 0; begin < count; begin += bundle.count) {
        bundle = gather(points + 3 * begin, count - begin, s->cell_m);
        for (k = 0; k < goals; k++) {
            if (vs_line_aim(&fan.middle, bundle.middle, goals_at + 3 * k, NULL, 0) != VS_OK)
                return VS_ERR_ARGUMENT;
            for (i = 0; i < bundle.count; i++) {
                fan.is_free[i] = 1;
                if (vs_line_aim(&fan.lines[i], points + 3 * (begin + i), goals_at + 3 * k,
                                skip + skips * (begin + i), skips) != VS_OK)
                    return VS_ERR_ARGUMENT;
            }
            fan.free = bundle.count;
            fan.suspects = 0;
            ask(s, &fan);
            for (i = 0; i < bundle.count; i++)
                seen[(begin + i) * goals + k] = fan.is_free[i];
        }
    }
    return VS_OK;
}
