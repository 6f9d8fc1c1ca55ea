/* SPDX-License-Identifier: MIT */
#include "vs_shape.h"

#include "vs_math.h"

#define DARK_LEAST 0.5 /* accepted dark share of the least area: the rest is cells */

/* Left and right border of each scanned row of one component [px]. */
struct borders {
    int rows;
    double left[VS_SHAPE_ROWS];
    double right[VS_SHAPE_ROWS];
};

static void find_borders(struct vs_scan *s, uint32_t root, struct borders *b)
{
    const struct vs_part *part = &s->parts[root];
    const struct vs_run *const runs = s->runs;
    uint32_t row, i;

    b->rows = part->bottom - part->top + 1;
    for (row = part->top; row <= part->bottom; row++) {
        double *left = &b->left[row - part->top];
        double *right = &b->right[row - part->top];

        *left = part->right;
        *right = part->left;
        for (i = s->first[row]; i < s->first[row + 1]; i++) {
            const struct vs_run *run = &runs[i];

            if (run->begin < part->left || run->end > part->right ||
                vs_scan_root(s, run->part) != root)
                continue;
            *left = run->begin < *left ? run->begin : *left;
            *right = run->end > *right ? run->end : *right;
        }
    }
}

/* Pushes a border outwards until it is convex; sense is 1 for a right one, else -1. */
static void make_convex(double *border, int rows, double sense)
{
    int corner[VS_SHAPE_ROWS];
    int corners = 0;
    int row, i;

    for (row = 0; row < rows; row++) {
        while (corners > 1) {
            int a = corner[corners - 2], b = corner[corners - 1];
            double turn = (border[b] - border[a]) * (row - a) -
                          (border[row] - border[a]) * (b - a);

            if (sense * turn > 0.0)
                break;
            corners--;
        }
        corner[corners++] = row;
    }
    for (i = 1; i < corners; i++) {
        int a = corner[i - 1], b = corner[i];

        for (row = a + 1; row < b; row++)
            border[row] = border[a] + (border[b] - border[a]) * (row - a) / (b - a);
    }
}

/* Area and centroid of the strips that the rows stand for. */
static double find_centroid(const struct borders *b, double top, struct vs_shape *shape)
{
    double area = 0.0, x = 0.0, y = 0.0;
    int row;

    for (row = 0; row < b->rows; row++) {
        double width = b->right[row] - b->left[row];

        area += width;
        x += width * 0.5 * (b->left[row] + b->right[row] - 1.0);
        y += width * (top + (double)VS_SCAN_STEP * row);
    }
    shape->x_px = x / area;
    shape->y_px = y / area;
    return area;
}

static void add_moments(const struct borders *b, double top, double area,
                        struct vs_shape *shape)
{
    const double high = VS_SCAN_STEP, spread = high * high / 12.0;
    struct vs_moments m = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
    int row;

    for (row = 0; row < b->rows; row++) {
        double width = b->right[row] - b->left[row];
        double x = 0.5 * (b->left[row] + b->right[row] - 1.0) - shape->x_px;
        double y = top + high * row - shape->y_px;
        double share = width / area;
        double wide = width * width / 12.0;

        m.xx += share * (x * x + wide);
        m.xy += share * x * y;
        m.yy += share * (y * y + spread);
        m.xxx += share * x * (x * x + 3.0 * wide);
        m.xxy += share * y * (x * x + wide);
        m.xyy += share * x * (y * y + spread);
        m.yyy += share * y * (y * y + 3.0 * spread);
    }
    shape->moments = m;
}

static void add_fourth_moments(const struct borders *b, double top, double area,
                               struct vs_shape *shape)
{
    const double high = VS_SCAN_STEP, spread = high * high / 12.0;
    struct vs_moments *m = &shape->moments;
    int row;

    for (row = 0; row < b->rows; row++) {
        double width = b->right[row] - b->left[row];
        double x = 0.5 * (b->left[row] + b->right[row] - 1.0) - shape->x_px;
        double y = top + high * row - shape->y_px;
        double share = width / area;
        double wide = width * width / 12.0;

        m->xxxx += share * (x * x * (x * x + 6.0 * wide) + 1.8 * wide * wide);
        m->xxxy += share * x * y * (x * x + 3.0 * wide);
        m->xxyy += share * (x * x + wide) * (y * y + spread);
        m->xyyy += share * x * y * (y * y + 3.0 * spread);
        m->yyyy += share * (y * y * (y * y + 6.0 * spread) + 1.8 * spread * spread);
    }
}

/* The moments after a linear map (a b; c d); those of the fourth order are not mapped. */
static struct vs_moments transform(const struct vs_moments *m, const double map[4])
{
    double a = map[0], b = map[1], c = map[2], d = map[3];
    struct vs_moments t = *m;

    t.xx = a * a * m->xx + 2.0 * a * b * m->xy + b * b * m->yy;
    t.xy = a * c * m->xx + (a * d + b * c) * m->xy + b * d * m->yy;
    t.yy = c * c * m->xx + 2.0 * c * d * m->xy + d * d * m->yy;
    t.xxx = a * a * a * m->xxx + 3.0 * a * a * b * m->xxy + 3.0 * a * b * b * m->xyy +
            b * b * b * m->yyy;
    t.xxy = a * a * c * m->xxx + a * (a * d + 2.0 * b * c) * m->xxy +
            b * (2.0 * a * d + b * c) * m->xyy + b * b * d * m->yyy;
    t.xyy = a * c * c * m->xxx + c * (2.0 * a * d + b * c) * m->xxy +
            d * (a * d + 2.0 * b * c) * m->xyy + b * d * d * m->yyy;
    t.yyy = c * c * c * m->xxx + 3.0 * c * c * d * m->xxy + 3.0 * c * d * d * m->xyy +
            d * d * d * m->yyy;
    return t;
}

/*
 * The longest axis carries the heading. Its sense comes from the third moments: an
 * arrow is skewed towards its tip along its axis, and is narrower there.
 */
int vs_shape_points(const struct vs_moments *moments, const double map[4],
                    const struct vs_shape_gate *gate, double ahead[2])
{
    struct vs_moments m = transform(moments, map);
    double twice = vs_root((m.xx - m.yy) * (m.xx - m.yy) + 4.0 * m.xy * m.xy);
    double along = 0.5 * (m.xx + m.yy + twice);
    double across = 0.5 * (m.xx + m.yy - twice);
    double c, s, skew, taper, point;

    if (!(along > gate->least_aspect * across && along < gate->most_aspect * across))
        return 0;
    c = vs_root(0.5 + 0.5 * (m.xx - m.yy) / twice);
    s = vs_root(0.5 - 0.5 * (m.xx - m.yy) / twice);
    s = m.xy < 0.0 ? -s : s;
    skew = c * c * c * m.xxx + 3.0 * c * c * s * m.xxy + 3.0 * c * s * s * m.xyy +
           s * s * s * m.yyy;
    taper = c * s * s * m.xxx + (s * s * s - 2.0 * c * c * s) * m.xxy +
            (c * c * c - 2.0 * c * s * s) * m.xyy + c * c * s * m.yyy;
    point = (skew / along - 2.0 * taper / across) / vs_root(along);
    if (!(point > gate->least_taper || point < -gate->least_taper))
        return 0;
    ahead[0] = point > 0.0 ? c : -c;
    ahead[1] = point > 0.0 ? s : -s;
    return 1;
}

/* a times b, as complex numbers. */
static void multiply(const double a[2], const double b[2], double product[2])
{
    double real = a[0] * b[0] - a[1] * b[1];

    product[1] = a[0] * b[1] + a[1] * b[0];
    product[0] = real;
}

/* The mean of (x + i y)^4 after a linear map. */
static void fourth_power(const struct vs_moments *m, const double map[4], double power[2])
{
    const double by_x[2] = {map[0], map[2]}, by_y[2] = {map[1], map[3]};
    double xx[2], xy[2], yy[2], part[5][2];
    int i;

    multiply(by_x, by_x, xx);
    multiply(by_x, by_y, xy);
    multiply(by_y, by_y, yy);
    multiply(xx, xx, part[0]);
    multiply(xx, xy, part[1]);
    multiply(xy, xy, part[2]);
    multiply(xy, yy, part[3]);
    multiply(yy, yy, part[4]);
    for (i = 0; i < 2; i++)
        power[i] = part[0][i] * m->xxxx + 4.0 * part[1][i] * m->xxxy +
                   6.0 * part[2][i] * m->xxyy + 4.0 * part[3][i] * m->xyyy +
                   part[4][i] * m->yyyy;
}

/* Halves the angle of a unit vector. */
static void halve(double unit[2])
{
    double c = vs_root(0.5 + 0.5 * unit[0]), s = vs_root(0.5 - 0.5 * unit[0]);

    unit[0] = c;
    unit[1] = unit[1] < 0.0 ? -s : s;
}

/*
 * A square with sides along x and y has a mean of (x + i y)^4 that is real and negative, and
 * turning it by an angle turns that by four times the angle.
 */
int vs_shape_corners(const struct vs_moments *moments, const double map[4],
                     const struct vs_shape_gate *gate, double ahead[2])
{
    struct vs_moments m = transform(moments, map);
    double twice = vs_root((m.xx - m.yy) * (m.xx - m.yy) + 4.0 * m.xy * m.xy);
    double all = m.xx + m.yy, power[2], size;

    fourth_power(moments, map, power);
    size = vs_root(power[0] * power[0] + power[1] * power[1]);
    if (!(all + twice < gate->most_aspect * (all - twice)) ||
        !(size > gate->least_square * all * all))
        return 0;
    ahead[0] = -power[0] / size;
    ahead[1] = -power[1] / size;
    halve(ahead);
    halve(ahead);
    return 1;
}

/* What can be told from the box around a part, before any of its runs is looked at. */
static int has_size(const struct vs_part *part, const struct vs_shape_gate *gate)
{
    double width = part->right - part->left;
    double height = VS_SCAN_STEP * (part->bottom - part->top + 1);

    return width > gate->least_px && height > gate->least_px && width < gate->most_px &&
           height < gate->most_px && part->bottom - part->top < VS_SHAPE_ROWS &&
           width * height > gate->least_px2 &&
           part->dark_px * (double)VS_SCAN_STEP > DARK_LEAST * gate->least_px2;
}

static int look_at(struct vs_scan *s, uint32_t root, const struct vs_shape_gate *gate,
                   struct vs_shape *shape)
{
    double top = (double)VS_SCAN_STEP * s->parts[root].top;
    struct borders b;
    double area;

    find_borders(s, root, &b);
    make_convex(b.left, b.rows, -1.0);
    make_convex(b.right, b.rows, 1.0);
    area = find_centroid(&b, top, shape);
    shape->area_px2 = area * VS_SCAN_STEP;
    if (!(shape->area_px2 > gate->least_px2 && shape->area_px2 < gate->most_px2))
        return 0;
    add_moments(&b, top, area, shape);
    if (gate->least_square > 0.0)
        add_fourth_moments(&b, top, area, shape);
    return 1;
}

void vs_shape_find(struct vs_scan *s, const struct vs_shape_gate *gate,
                   struct vs_shape *found, size_t capacity, size_t *count)
{
    const struct vs_part *const parts = s->parts;
    uint32_t i;

    *count = 0;
    for (i = 0; i < s->part_count; i++) {
        struct vs_shape shape;

        if (parts[i].parent != i || !has_size(&parts[i], gate) ||
            !look_at(s, i, gate, &shape))
            continue;
        if (*count == capacity) {
            s->full |= VS_MARKERS_FULL_FOUND;
            return;
        }
        found[(*count)++] = shape;
    }
}
