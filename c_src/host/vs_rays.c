/* SPDX-License-Identifier: MIT */
#include "vs_rays.h"

#include <math.h>

#include "vs_line.h"
#include "vs_math.h"

#define UPRIGHT_M2 1e-24  /* squared length of a line's plan that counts as a point */

/* Cuts [*from, *to] down to where start + t * way lies in [low, high]; 0: nothing is left. */
static int cut(double start, double way, double pace, double low, double high,
               double *from, double *to)
{
    double a, b;

    if (way == 0.0)
        return start >= low && start <= high;
    a = (low - start) * pace;
    b = (high - start) * pace;
    *from = vs_most(*from, vs_least(a, b));
    *to = vs_least(*to, vs_most(a, b));
    return *from <= *to;
}

int vs_line_cut(const struct vs_line *line, int axis, double low, double high, double *from,
                double *to)
{
    return cut(line->start[axis], line->way[axis], line->pace[axis], low, high, from, to);
}

/* Whether a line, however long, misses a cylinder seen from above: most do, so this is asked first. */
static int passes_by(const struct vs_obstacle *body, const struct vs_line *line)
{
    double x_m = line->start[0] - body->x_m, y_m = line->start[1] - body->y_m;
    double across = x_m * line->way[1] - y_m * line->way[0];

    return across * across > body->radius_m * body->radius_m * line->plan2;
}

/* Where in [from, to] a line first touches a cylinder seen from above; infinity: nowhere. */
static double meet_disc(const struct vs_obstacle *body, const struct vs_line *line,
                        double from, double to, int any)
{
    double x_m = line->start[0] - body->x_m, y_m = line->start[1] - body->y_m;
    double radius2 = body->radius_m * body->radius_m;
    double across = x_m * line->way[1] - y_m * line->way[0];
    double middle = from, closest, half;

    if (line->plan2 > UPRIGHT_M2)
        middle = -(x_m * line->way[0] + y_m * line->way[1]) / line->plan2;
    closest = vs_most(from, vs_least(to, middle));
    x_m += closest * line->way[0];
    y_m += closest * line->way[1];
    if (x_m * x_m + y_m * y_m > radius2)
        return INFINITY;
    if (any || line->plan2 <= UPRIGHT_M2)
        return from;
    half = vs_root((radius2 - across * across / line->plan2) / line->plan2);
    return vs_most(from, vs_least(to, middle - half));
}

/* The same for a box. */
static double meet_box(const struct vs_obstacle *body, const struct vs_line *line,
                       double from, double to)
{
    double x_m = line->start[0] - body->x_m, y_m = line->start[1] - body->y_m;
    double along = x_m * body->cosine + y_m * body->sine;
    double aside = y_m * body->cosine - x_m * body->sine;
    double way_along = line->way[0] * body->cosine + line->way[1] * body->sine;
    double way_aside = line->way[1] * body->cosine - line->way[0] * body->sine;
    double half_x_m = body->half_x_m, half_y_m = body->half_y_m;

    if (!cut(along, way_along, 1.0 / way_along, -half_x_m, half_x_m, &from, &to) ||
        !cut(aside, way_aside, 1.0 / way_aside, -half_y_m, half_y_m, &from, &to))
        return INFINITY;
    return from;
}

int vs_line_has_nose(const struct vs_obstacle *body, struct vs_obstacle *nose)
{
    if (!(body->radius_m > 0.0 && body->half_y_m > 0.0))
        return 0;
    *nose = *body;
    nose->x_m += body->half_x_m * body->cosine;
    nose->y_m += body->half_x_m * body->sine;
    nose->radius_m = body->half_y_m;
    nose->half_x_m = nose->half_y_m = 0.0;
    return 1;
}

/* The first touch of a line with a nose that it does not start in. */
static double meet_nose(const struct vs_obstacle *nose, const struct vs_line *line, int any)
{
    double x_m = line->start[0] - nose->x_m, y_m = line->start[1] - nose->y_m;

    if (x_m * x_m + y_m * y_m <= nose->radius_m * nose->radius_m)
        return INFINITY;
    return vs_line_meet(nose, line, any);
}

double vs_line_meet(const struct vs_obstacle *body, const struct vs_line *line, int any)
{
    struct vs_obstacle nose, whole;
    double from = 0.0, to = 1.0;

    if (vs_line_has_nose(body, &nose)) {
        whole = *body;
        whole.half_y_m = 0.0;
        return vs_least(meet_nose(&nose, line, any), vs_line_meet(&whole, line, any));
    }
    if ((body->radius_m > 0.0 && passes_by(body, line)) ||
        !vs_line_cut(line, 2, body->z_low_m, body->z_high_m, &from, &to))
        return INFINITY;
    if (body->radius_m > 0.0)
        return meet_disc(body, line, from, to, any);
    return meet_box(body, line, from, to);
}

/* The first touch of a line with the bodies of one cell. */
static double meet_cell(const struct vs_obstacles *s, int32_t cell,
                        const struct vs_line *line, int any)
{
    double first = INFINITY;
    uint32_t i;

    for (i = s->first[cell]; i < s->first[cell + 1]; i++) {
        int32_t number = (int32_t)s->inside[i];

        if (number == line->skip[0] || number == line->skip[1])
            continue;
        first = vs_least(first, vs_line_meet(&s->bodies[number], line, any));
        if (any && first <= 1.0)
            break;
    }
    return first;
}

/* How a line goes through the columns of the grid, or through its rows. */
struct walk {
    double start;   /* of the line, from the grid's corner */
    double way;
    double pace;
    double cell_m;
    double end;     /* share of the line at which it leaves the current cell */
    int32_t cell;
    int32_t cells;
};

static void set_end(struct walk *w)
{
    int32_t border = w->way > 0.0 ? w->cell + 1 : w->cell;

    w->end = w->way == 0.0 ? INFINITY : (border * w->cell_m - w->start) * w->pace;
}

static struct walk begin(const struct vs_obstacles *s, const struct vs_line *line, int axis,
                         double from)
{
    struct walk walk;
    double corner_m = axis == 0 ? s->left_m : s->near_m;

    walk.start = line->start[axis] - corner_m;
    walk.way = line->way[axis];
    walk.pace = line->pace[axis];
    walk.cell_m = s->cell_m;
    walk.cells = axis == 0 ? s->columns : s->rows;
    walk.cell = vs_line_cell(s, walk.start + from * walk.way, walk.cells);
    set_end(&walk);
    return walk;
}

/* Goes to the next cell; 0 if the grid ends. */
static int go_on(struct walk *w)
{
    w->cell += w->way > 0.0 ? 1 : -1;
    set_end(w);
    return w->cell >= 0 && w->cell < w->cells;
}

/* Goes from cell to cell until it is known where the line first touches a body. */
static double trace(const struct vs_obstacles *s, const struct vs_line *line, int any)
{
    double from = 0.0, to = 1.0, first = INFINITY;
    struct walk x, y;

    if (s->columns == 0 ||
        !vs_line_cut(line, 2, s->low_m, s->high_m, &from, &to) ||
        !vs_line_cut(line, 0, s->left_m, s->left_m + s->columns * s->cell_m, &from, &to) ||
        !vs_line_cut(line, 1, s->near_m, s->near_m + s->rows * s->cell_m, &from, &to))
        return INFINITY;
    x = begin(s, line, 0, from);
    y = begin(s, line, 1, from);
    for (;;) {
        double end = vs_least(x.end, y.end);

        first = vs_least(first, meet_cell(s, y.cell * s->columns + x.cell, line, any));
        if ((any && first <= 1.0) || first <= end || end >= to)
            return first;
        if (!go_on(x.end < y.end ? &x : &y))
            return first;
    }
}

int vs_line_aim(struct vs_line *line, const double start[3], const double end[3],
                const int32_t *skip, size_t skips)
{
    size_t i;

    if (skips > VS_RAYS_MAX_SKIPS)
        return VS_ERR_ARGUMENT;
    for (i = 0; i < 3; i++) {
        if (!vs_is_within(start[i], -VS_OBSTACLES_LIMIT_M, VS_OBSTACLES_LIMIT_M) ||
            !vs_is_within(end[i], -VS_OBSTACLES_LIMIT_M, VS_OBSTACLES_LIMIT_M))
            return VS_ERR_ARGUMENT;
        line->start[i] = start[i];
        line->way[i] = end[i] - start[i];
        line->pace[i] = line->way[i] == 0.0 ? 0.0 : 1.0 / line->way[i];
    }
    line->plan2 = line->way[0] * line->way[0] + line->way[1] * line->way[1];
    for (i = 0; i < VS_RAYS_MAX_SKIPS; i++)
        line->skip[i] = i < skips ? skip[i] : -1;
    return VS_OK;
}

int vs_rays_blocked(const struct vs_obstacles *obstacles, const double *starts,
                    const double *ends, size_t count, const int32_t *skip, size_t skips,
                    uint8_t *blocked)
{
    struct vs_line line;
    size_t i;

    for (i = 0; i < count; i++) {
        if (vs_line_aim(&line, starts + 3 * i, ends + 3 * i, skip + skips * i, skips) != VS_OK)
            return VS_ERR_ARGUMENT;
        blocked[i] = trace(obstacles, &line, 1) <= 1.0;
    }
    return VS_OK;
}

int vs_rays_nearest(const struct vs_obstacles *obstacles, const double *starts,
                    const double *ends, size_t count, const int32_t *skip, size_t skips,
                    double *shares)
{
    struct vs_line line;
    size_t i;

    for (i = 0; i < count; i++) {
        if (vs_line_aim(&line, starts + 3 * i, ends + 3 * i, skip + skips * i, skips) != VS_OK)
            return VS_ERR_ARGUMENT;
        shares[i] = trace(obstacles, &line, 0);
    }
    return VS_OK;
}
