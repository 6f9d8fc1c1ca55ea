/* SPDX-License-Identifier: MIT */
#include "vs_field.h"

#include <stddef.h>
#include <string.h>

#include "../vs_err.h"
#include "vs_math.h"
#include "vs_place.h"

/* The four cells around a place, and their shares of it. */
struct corners {
    size_t cells[4];
    double shares[4];
};

/* Along one axis: the cell below a place, the one above, and how near that is. */
static void split(double place, uint32_t cells, size_t *low, size_t *high, double *share)
{
    double last = cells - 1.0;
    double inside = vs_least(vs_most(place, 0.0), last);
    size_t before = (size_t)inside;

    if (cells > 1 && before > cells - 2)
        before = cells - 2;
    *low = before;
    *high = before + 1 < cells ? before + 1 : cells - 1;
    *share = inside - (double)before;
}

/* Where a place lies; (0, 0) is the middle of the first cell. */
static struct corners around(const struct vs_field *field, double x, double y)
{
    struct corners found;
    size_t left, right, near, far;
    double u, v;

    split(x, field->columns, &left, &right, &u);
    split(y, field->rows, &near, &far, &v);
    found.cells[0] = near * field->columns + left;
    found.cells[1] = near * field->columns + right;
    found.cells[2] = far * field->columns + left;
    found.cells[3] = far * field->columns + right;
    found.shares[0] = (1.0 - u) * (1.0 - v);
    found.shares[1] = u * (1.0 - v);
    found.shares[2] = (1.0 - u) * v;
    found.shares[3] = u * v;
    return found;
}

static double value(const struct vs_field *field, double x, double y)
{
    struct corners at = around(field, x, y);
    double sum = field->cells[at.cells[0]] * at.shares[0];
    uint32_t i;

    for (i = 1; i < 4; i++)
        sum += field->cells[at.cells[i]] * at.shares[i];
    return sum;
}

static double in_cells(const struct vs_field *field, const double *point_m, uint32_t axis)
{
    return (point_m[axis] - field->corner_m[axis]) / field->cell_m - 0.5;
}

void vs_field_read(const struct vs_field *field, const double *points_m, uint32_t n,
                   double *readings)
{
    double ends_m = 2.0 * field->cell_m;
    uint32_t i;

    for (i = 0; i < n; i++) {
        double x = in_cells(field, points_m + 2 * i, 0);
        double y = in_cells(field, points_m + 2 * i, 1);

        readings[3 * i] = value(field, x, y);
        readings[3 * i + 1] = (value(field, x + 1.0, y) - value(field, x - 1.0, y)) / ends_m;
        readings[3 * i + 2] = (value(field, x, y + 1.0) - value(field, x, y - 1.0)) / ends_m;
    }
}

void vs_field_deposit(struct vs_field *field, const double *points_m, const double *amounts,
                      uint32_t n, double most)
{
    double area_m2 = field->cell_m * field->cell_m;
    uint32_t i, k;

    for (i = 0; i < n; i++) {
        struct corners at = around(field, in_cells(field, points_m + 2 * i, 0),
                                   in_cells(field, points_m + 2 * i, 1));

        for (k = 0; k < 4; k++)
            field->cells[at.cells[k]] += amounts[i] * at.shares[k] / area_m2;
        for (k = 0; k < 4; k++)
            field->cells[at.cells[k]] = vs_least(field->cells[at.cells[k]], most);
    }
}

static void diffuse(struct vs_field *field, double share, double *before)
{
    size_t columns = field->columns, rows = field->rows, x, y;

    memcpy(before, field->cells, columns * rows * sizeof *before);
    for (y = 0; y < rows; y++) {
        const double *at = before + y * columns;
        double *to = field->cells + y * columns;

        for (x = 0; x + 1 < columns; x++)
            to[x] += share * (at[x + 1] - at[x]);
        for (x = 1; x < columns; x++)
            to[x] -= share * (at[x] - at[x - 1]);
        for (x = 0; x < columns && y + 1 < rows; x++)
            to[x] += share * (at[x + columns] - at[x]);
        for (x = 0; x < columns && y > 0; x++)
            to[x] -= share * (at[x] - at[x - columns]);
    }
}

void vs_spread_step(const struct vs_spread *spread)
{
    size_t cells = (size_t)spread->field->columns * spread->field->rows, c;
    uint32_t i;

    for (i = 0; i < spread->substeps; i++)
        diffuse(spread->field, spread->share, spread->before);
    for (c = 0; c < cells && spread->left != 1.0; c++)
        spread->field->cells[c] *= spread->left;
}

int vs_field_sense(const void *field, const struct vs_scene *scene, double *readings)
{
    uint32_t i;

    for (i = 0; i < scene->robots; i++) {
        struct vs_place place = vs_place_of(scene, i);
        double point_m[2] = {place.x_m, place.y_m};
        double *reading = readings + 3 * (size_t)i;
        double sine, cosine, east, north;

        vs_field_read(field, point_m, 1, reading);
        vs_sin_cos(place.yaw_rad, &sine, &cosine);
        east = reading[1];
        north = reading[2];
        reading[1] = east * cosine + north * sine;
        reading[2] = north * cosine - east * sine;
    }
    return VS_OK;
}

int vs_field_release(const void *release, const struct vs_scene *scene, const double *levels,
                     const double *growth)
{
    const struct vs_release *how = release;
    uint32_t i;

    for (i = 0; i < scene->robots; i++) {
        double amount = levels[2 * i] * how->timestep_s + growth[2 * i + 1];
        struct vs_place place = vs_place_of(scene, i);
        double point_m[2] = {place.x_m, place.y_m};

        if (amount > how->most)
            return VS_ERR_ARGUMENT;
        if (amount > 0.0)
            vs_field_deposit(how->field, point_m, &amount, 1, how->most);
    }
    return VS_OK;
}
