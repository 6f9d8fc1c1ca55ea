/* SPDX-License-Identifier: MIT */
#include "vs_near.h"

#include "vs_math.h"

#define SKIN_M 0.02  /* extra reach of the pairs: they hold until somebody moved half of it */
#define MOVED_M (SKIN_M / 2.0 / 1.4142135623730951) /* along one axis */
#define NONE UINT32_MAX
#define FEW 48           /* bodies: so many are compared with each other faster than sorted */
#define FARTHEST 1.0e9   /* cells from the origin */

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

static void add_if_near(struct vs_near *near, uint32_t robot, uint32_t b)
{
    const double *at = near->searched_m;
    double reach_m = near->reach_m + SKIN_M + near->radii_m[b];
    double x = at[2 * b] - at[2 * robot];
    double y = at[2 * b + 1] - at[2 * robot + 1];

    if (x * x + y * y < reach_m * reach_m && b != robot)
        add(near, robot, b);
}

/* A grid whose cells are as wide as anybody reaches; cells share the lists of the table heads. */
struct grid {
    double cell_m;
    uint32_t mask;
};

static int32_t cell_of(const struct grid *grid, double at_m)
{
    double cell = vs_most(-FARTHEST, vs_least(at_m / grid->cell_m, FARTHEST));
    int32_t whole = (int32_t)cell;

    return cell < (double)whole ? whole - 1 : whole;
}

static uint32_t list_of(const struct grid *grid, int32_t column, int32_t row)
{
    uint32_t mixed = (uint32_t)column * 73856093u ^ (uint32_t)row * 19349663u;

    return (mixed ^ mixed >> 15) & grid->mask;
}

/* Sorts all bodies into cells; each list has the highest number first. */
static struct grid lay(struct vs_near *near)
{
    struct grid grid;
    double widest_m = 0.0;
    uint32_t b;

    for (b = 0; b < near->bodies; b++)
        widest_m = vs_most(widest_m, near->radii_m[b]);
    grid.cell_m = (near->reach_m + SKIN_M + widest_m) * 1.000001; /* more than rounding */
    for (grid.mask = 1; grid.mask < near->bodies;)
        grid.mask = 2 * grid.mask;
    grid.mask--;
    for (b = 0; b <= grid.mask; b++)
        near->heads[b] = NONE;
    for (b = 0; b < near->bodies; b++) {
        const double *at = near->searched_m + 2 * b;
        uint32_t list = list_of(&grid, cell_of(&grid, at[0]), cell_of(&grid, at[1]));

        near->next[b] = near->heads[list];
        near->heads[list] = b;
    }
    return grid;
}

/* Adds who is near a robot of those in one cell. */
static void search_cell(struct vs_near *near, const struct grid *grid, uint32_t robot,
                        int32_t column, int32_t row)
{
    uint32_t b = near->heads[list_of(grid, column, row)];

    for (; b != NONE; b = near->next[b]) {
        const double *at = near->searched_m + 2 * b;

        /* Another cell may share the list. */
        if (cell_of(grid, at[0]) == column && cell_of(grid, at[1]) == row)
            add_if_near(near, robot, b);
    }
}

/* Brings pairs of one robot, few of them, into the order of the others. */
static void order(struct vs_pair *pairs, uint32_t count)
{
    uint32_t i, k;

    for (i = 1; i < count; i++) {
        struct vs_pair pair = pairs[i];

        for (k = i; k > 0 && pairs[k - 1].other > pair.other; k--)
            pairs[k] = pairs[k - 1];
        pairs[k] = pair;
    }
}

static void search_grid(struct vs_near *near, const struct grid *grid, uint32_t robot)
{
    const double *at = near->searched_m + 2 * robot;
    int32_t column = cell_of(grid, at[0]), row = cell_of(grid, at[1]), i, k;
    uint32_t first = near->count;

    for (i = column - 1; i <= column + 1; i++)
        for (k = row - 1; k <= row + 1; k++)
            search_cell(near, grid, robot, i, k);
    order(near->pairs + first, near->count - first);
}

static void search_all(struct vs_near *near, uint32_t robot)
{
    uint32_t b;

    for (b = 0; b < near->bodies; b++)
        add_if_near(near, robot, b);
}

static void search_boxes(struct vs_near *near, uint32_t robot)
{
    const double *at = near->searched_m + 2 * robot;
    double normal[2];
    uint32_t b;

    for (b = 0; b < near->boxes; b++) {
        const double *row = near->box_rows + VS_BOX_NUMBERS * b;

        if (vs_box_gap(row, at[0], at[1], normal) < near->reach_m + SKIN_M / 2.0)
            add(near, robot, near->bodies + b);
    }
}

void vs_near_update(struct vs_near *near, const double *positions_m, uint32_t stride)
{
    struct grid grid = {0.0, 0};
    uint32_t b;

    if (!is_due(near, positions_m, stride))
        return;
    near->searches++;
    near->count = 0;
    for (b = 0; b < near->bodies; b++) {
        near->searched_m[2 * b] = positions_m[b * stride];
        near->searched_m[2 * b + 1] = positions_m[b * stride + 1];
    }
    if (near->bodies >= FEW)
        grid = lay(near);
    for (b = 0; b < near->robots; b++) {
        if (near->bodies >= FEW)
            search_grid(near, &grid, b);
        else
            search_all(near, b);
        search_boxes(near, b);
    }
}
