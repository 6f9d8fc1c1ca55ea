/* SPDX-License-Identifier: MIT */
#include "vs_corners.h"

#include "vs_lens.h"
#include "vs_math.h"

#define SIDE_SHARE 0.4  /* of the shorter side is looked at on both sides of a corner */
#define LEAST_STEPS 5   /* along the border; shorter sides have no direction */
#define STRAIGHT_PX 1.1 /* what a side's middle may be beside the line between its ends */
#define TURN 0.3        /* cosine: corners of 90 degrees, give or take 17 */
#define MAP_EVERY 256   /* pixels of a border that have one scale */
#define EVERY 2         /* which pixels of a border are looked at */
#define STEEP_PX 3.0    /* from outside to inside of a corner, on both sides of it */
#define GLANCES 24      /* places along an outline */
#define BESIDE_U 0.5    /* looked at inside and outside of them */
#define LEAST_RIGHT 0.5 /* of them */

/* Neighbours of a pixel, clockwise as a picture is seen, the first to the right. */
static const int8_t step_x[8] = {1, 1, 0, -1, -1, -1, 0, 1};
static const int8_t step_y[8] = {0, 1, 1, 1, 0, -1, -1, -1};

static int is_dark(const struct vs_scan *s, const struct vs_picture *part, int32_t x, int32_t y)
{
    if ((uint32_t)x >= (uint32_t)part->width_px || (uint32_t)y >= (uint32_t)part->height_px)
        return 0;
    return part->pixels[(size_t)y * part->stride + (size_t)x] <
           s->level[(uint32_t)y / VS_SCAN_BLOCK * s->line + (uint32_t)x / VS_SCAN_BLOCK];
}

/* Follows the border of what is dark at a pixel whose left neighbour is light. */
static void follow(const struct vs_scan *s, const struct vs_picture *part, int32_t x, int32_t y,
                   struct vs_border *border)
{
    const int32_t first_x = x, first_y = y;
    int back = 4, k;

    border->count = 0;
    border->is_closed = 0;
    while (border->count < VS_CORNERS_LENGTH) {
        border->x[border->count] = (uint16_t)x;
        border->y[border->count++] = (uint16_t)y;
        for (k = 1; k < 8; k++) {
            if (is_dark(s, part, x + step_x[(back + k) & 7], y + step_y[(back + k) & 7]))
                break;
        }
        if (k == 8)
            return;
        k = (back + k) & 7;
        x += step_x[k];
        y += step_y[k];
        back = (k + (k % 2 == 0 ? 6 : 5)) & 7;
        border->is_closed = x == first_x && y == first_y && back == 4;
        if (border->is_closed)
            return;
    }
}

/* How far the middle of a piece of the border lies beside the line between its ends, squared. */
static double bend_px2(const struct vs_border *border, uint32_t from, uint32_t middle,
                       uint32_t to)
{
    double x = border->x[middle] - 0.5 * (border->x[from] + border->x[to]);
    double y = border->y[middle] - 0.5 * (border->y[from] + border->y[to]);

    return x * x + y * y;
}

/* Turns a step in the picture into a unit vector on the plane. */
static void direction(const double map[4], double x_px, double y_px, double unit[2])
{
    double x = map[0] * x_px + map[1] * y_px, y = map[2] * x_px + map[3] * y_px;
    double length = vs_root(x * x + y * y);

    unit[0] = x / length;
    unit[1] = y / length;
}

/*
 * How little a place of the border is a corner whose sides go on for some steps: what they bend,
 * squared [px^2]; negative where it is none. inward_m as in struct vs_corner.
 */
static double look_at(const struct vs_border *border, const double map[4], uint32_t at,
                      uint32_t steps, double inward_m[2])
{
    const uint16_t *x = border->x, *y = border->y;
    uint32_t from = at < steps ? at + border->count - steps : at - steps;
    uint32_t to = at + steps < border->count ? at + steps : at + steps - border->count;
    uint32_t half = steps / 2, middle = at < half ? at + border->count - half : at - half;
    int32_t in_x = x[at] - x[from], in_y = y[at] - y[from];
    int32_t out_x = x[to] - x[at], out_y = y[to] - y[at];
    double before, after, in[2], out[2], length;

    if (4 * (in_x * out_y - in_y * out_x) <= (int32_t)(steps * steps))
        return -1.0;
    before = bend_px2(border, from, middle, at);
    middle = at + half < border->count ? at + half : at + half - border->count;
    after = bend_px2(border, at, middle, to);
    if (before > STRAIGHT_PX * STRAIGHT_PX || after > STRAIGHT_PX * STRAIGHT_PX)
        return -1.0;
    direction(map, in_x, in_y, in);
    direction(map, out_x, out_y, out);
    length = in[0] * out[0] + in[1] * out[1];
    if (!(length < TURN && length > -TURN))
        return -1.0;
    length = vs_root(2.0 - 2.0 * length);
    inward_m[0] = (out[0] - in[0]) / length;
    inward_m[1] = (out[1] - in[1]) / length;
    return before + after;
}

/* How many pixels of the border from a place on make most of a marker's side; 0: nowhere. */
static uint32_t measure(const struct vs_border *border, uint32_t place, double side_m,
                        const struct vs_view *view, const int32_t origin[2], double map[4])
{
    double place_m[2], area, steps;

    if (!vs_lens_map(view, border->x[place] + origin[0], border->y[place] + origin[1], place_m,
                     map))
        return 0;
    area = map[0] * map[3] - map[1] * map[2];
    steps = SIDE_SHARE * side_m / vs_root(area < 0.0 ? -area : area);
    if (!(steps < VS_CORNERS_LENGTH)) /* longer than any border, as where a lens folds; or no number */
        return 0;
    return steps < LEAST_STEPS ? LEAST_STEPS : (uint32_t)steps;
}

/* Whether it is darker on one side of a border pixel than on the other, a step each away. */
static int is_steep(const struct vs_picture *picture, double x_px, double y_px, double x_step,
                    double y_step, int32_t least)
{
    int32_t x = (int32_t)x_px, y = (int32_t)y_px, dx = (int32_t)x_step, dy = (int32_t)y_step;
    const uint8_t *here = picture->pixels + (size_t)y * picture->stride + (size_t)x;

    if (x < 4 || y < 4 || x >= picture->width_px - 4 || y >= picture->height_px - 4)
        return 0;
    return here[-(ptrdiff_t)picture->stride * dy - dx] -
               here[(ptrdiff_t)picture->stride * dy + dx] >
           least;
}

/*
 * Places a corner on the markers' plane; returns 1, or 0 where it is not on it, or where it is
 * hardly darker inside than outside.
 */
static int place(const struct vs_border *border, uint32_t at, uint32_t steps,
                 const struct vs_view *view, const int32_t origin[2], int32_t least,
                 struct vs_corner *corner)
{
    uint32_t count = border->count, from = (at + count - steps) % count, to = (at + steps) % count;
    double x = border->x[to] + border->x[from] - 2.0 * border->x[at];
    double y = border->y[to] + border->y[from] - 2.0 * border->y[at];
    double scale = STEEP_PX / (vs_root(x * x + y * y) + 1e-9);

    corner->x_px = border->x[at] + origin[0];
    corner->y_px = border->y[at] + origin[1];
    if (!is_steep(&view->picture, corner->x_px, corner->y_px, x * scale, y * scale, least))
        return 0;
    return vs_lens_map(view, corner->x_px, corner->y_px, corner->place_m, corner->map);
}

/* Adds the corners of a border, the straightest of those that are near each other. */
static void add_corners(const struct vs_border *border, const struct vs_search *search,
                        const struct vs_view *view, const int32_t origin[2],
                        struct vs_corner *found, size_t capacity, size_t *count)
{
    double map[4] = {0.0, 0.0, 0.0, 0.0}, best = -1.0;
    uint32_t i, steps = 0, best_at = 0;

    for (i = 0; i < border->count && *count < capacity; i += EVERY) {
        double inward_m[2], bend;

        if (i % MAP_EVERY == 0)
            steps = measure(border, i, search->corner_side_m, view, origin, map);
        if (steps == 0 || border->count < 4 * steps ||
            (!border->is_closed && (i < steps || i + steps >= border->count)))
            continue;
        bend = look_at(border, map, i, steps, inward_m);
        if (bend >= 0.0 && (best < 0.0 || bend < best)) {
            best = bend;
            best_at = i;
            found[*count].inward_m[0] = inward_m[0];
            found[*count].inward_m[1] = inward_m[1];
        }
        if (best >= 0.0 && i - best_at > steps / 2) {
            best = -1.0;
            *count += (size_t)place(border, best_at, steps, view, origin,
                                    search->least_contrast / 2, &found[*count]);
        }
    }
}

/* Whether no marker is as large as a part, and it holds one. */
static int is_large(const struct vs_part *part, const struct vs_shape_gate *gate)
{
    double width = part->right - part->left;
    double height = VS_SCAN_STEP * (part->bottom - part->top + 1);

    return width > gate->least_px && height > gate->least_px &&
           (width > gate->most_px || height > gate->most_px);
}

void vs_corners_find(struct vs_scan *s, const struct vs_picture *part,
                     const struct vs_search *search, const struct vs_view *view,
                     const int32_t origin[2], struct vs_border *border,
                     struct vs_corner *found, size_t capacity, size_t *count)
{
    uint32_t i, k;

    *count = 0;
    for (i = 0; i < s->part_count; i++) {
        const struct vs_part *thing = &s->parts[i];

        if (thing->parent != i || !is_large(thing, &search->gate))
            continue;
        for (k = s->first[thing->top]; vs_scan_root(s, s->runs[k].part) != i; k++)
            ;
        follow(s, part, s->runs[k].begin, VS_SCAN_STEP * thing->top, border);
        add_corners(border, search, view, origin, found, capacity, count);
    }
}

/* The grey of the pixel at a place of the plane near a corner; -1 outside of the picture. */
static int look(const struct vs_picture *picture, const struct vs_corner *corner,
                const double back[4], double x_m, double y_m)
{
    double x = corner->x_px + back[0] * x_m + back[1] * y_m + 0.5;
    double y = corner->y_px + back[2] * x_m + back[3] * y_m + 0.5;

    if (!(x >= 0.0 && y >= 0.0 && x < picture->width_px && y < picture->height_px))
        return -1;
    return picture->pixels[(size_t)y * picture->stride + (size_t)x];
}

int vs_corners_glance(const struct vs_outline *outline, const struct vs_picture *picture,
                      const struct vs_corner *corner, const struct vs_marker *marker)
{
    const double *map = corner->map;
    double area = map[0] * map[3] - map[1] * map[2], beside_m = BESIDE_U * outline->unit_m;
    double c = marker->ahead_x, s = marker->ahead_y, back[4];
    int stride = outline->samples / GLANCES, looked = 0, right = 0, i;

    back[0] = map[3] / area;
    back[1] = -map[1] / area;
    back[2] = -map[2] / area;
    back[3] = map[0] / area;
    for (i = stride / 2; i < outline->samples; i += stride) {
        double x = outline->x_m[i], y = outline->y_m[i];
        double nx = beside_m * (c * outline->normal_x[i] - s * outline->normal_y[i]);
        double ny = beside_m * (s * outline->normal_x[i] + c * outline->normal_y[i]);
        double x_m = marker->x_m - corner->place_m[0] + c * x - s * y;
        double y_m = marker->y_m - corner->place_m[1] + s * x + c * y;
        int inside = look(picture, corner, back, x_m - nx, y_m - ny);
        int outside = look(picture, corner, back, x_m + nx, y_m + ny);

        right += inside >= 0 && outside - inside > 0.5 * outline->least_contrast;
        looked++;
    }
    return right > LEAST_RIGHT * looked;
}
