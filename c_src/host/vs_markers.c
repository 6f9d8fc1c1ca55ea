/* SPDX-License-Identifier: MIT */
#include "vs_markers.h"

#include <string.h>

#include "vs_codes.h"
#include "vs_corners.h"
#include "vs_edges.h"
#include "vs_lens.h"
#include "vs_math.h"
#include "vs_outline.h"
#include "vs_shape.h"
#include "vs_square.h"

#define SHAPES 1024 /* candidates in a picture */
#define CORNERS 1024 /* of what is too large */
#define LEAST_SEEN 0.7 /* of an outline that something lies over: three sides of a square */

/* The tables of the scan follow it in memory: parts, then runs. */
struct vs_markers {
    struct vs_shape shapes[SHAPES];
    struct vs_spot known[SHAPES];
    struct vs_border border;
    struct vs_corner corners[CORNERS];
    struct vs_scan scan;
};

static int32_t cut(int32_t value, int32_t most)
{
    return value < 0 ? 0 : value > most ? most : value;
}

/* The whole picture's, whatever part of it is searched: places in it are numbers of 32 bits. */
static int check_picture(const struct vs_picture *picture)
{
    if (picture->width_px < 0 || picture->width_px > VS_MARKERS_SIDE ||
        picture->height_px < 0 || picture->height_px > VS_MARKERS_SIDE ||
        picture->stride < (size_t)picture->width_px)
        return VS_ERR_ARGUMENT;
    return VS_OK;
}

/* Runs that there is room for in a picture: texture has as many per pixel in any. */
static uint32_t run_room(int32_t width_px, int32_t height_px)
{
    uint32_t pixels = (uint32_t)cut(width_px, VS_MARKERS_SIDE) *
                      (uint32_t)cut(height_px, VS_MARKERS_SIDE);
    uint32_t room = pixels / VS_SCAN_SPREAD;

    return room > VS_SCAN_RUNS ? room : VS_SCAN_RUNS;
}

size_t vs_markers_size(int32_t width_px, int32_t height_px)
{
    size_t runs = run_room(width_px, height_px);

    return sizeof(struct vs_markers) + runs / 2 * sizeof(struct vs_part) +
           runs * sizeof(struct vs_run);
}

/* Lays the tables out for pictures of a size. */
static void lay_out(struct vs_markers *work, const struct vs_picture *picture)
{
    struct vs_scan *scan = &work->scan;

    scan->run_room = run_room(picture->width_px, picture->height_px);
    scan->part_room = scan->run_room / 2;
    scan->parts = (struct vs_part *)(void *)(work + 1);
    scan->runs = (struct vs_run *)(void *)(scan->parts + scan->part_room);
}

/* The pose that a candidate's moments suggest; 0 if it is no marker. */
static int begin_marker(const struct vs_search *search, const struct vs_view *view,
                        const struct vs_shape *shape, struct vs_marker *marker)
{
    double centroid_m[2], map[4], ahead[2], bend, area_m2;
    int is_marker;

    if (!vs_lens_map(view, shape->x_px, shape->y_px, centroid_m, map))
        return 0;
    bend = map[0] * map[3] - map[1] * map[2];
    area_m2 = shape->area_px2 * (bend < 0.0 ? -bend : bend);
    if (!(area_m2 > search->gate.least_m2 && area_m2 < search->gate.most_m2))
        return 0;
    is_marker = search->gate.least_square > 0.0
                    ? vs_shape_corners(&shape->moments, map, &search->gate, ahead)
                    : vs_shape_points(&shape->moments, map, &search->gate, ahead);
    if (!is_marker)
        return 0;
    memset(marker, 0, sizeof *marker);
    marker->ahead_x = ahead[0];
    marker->ahead_y = ahead[1];
    marker->x_m = centroid_m[0] + search->lead_m * ahead[0];
    marker->y_m = centroid_m[1] + search->lead_m * ahead[1];
    marker->scale = 1.0;
    return 1;
}

/* Reads a marker that has been fitted. */
static void read_marker(const struct vs_outline *outline, const struct vs_view *view,
                        struct vs_marker *marker)
{
    marker->tag = marker->guess = -1.0;
    if (outline->words != NULL)
        vs_square_name(outline->words, view, marker);
    vs_outline_read(outline, view, marker);
    if (outline->codes != NULL)
        vs_codes_name(outline->codes, marker, 1);
}

/*
 * Adds a marker unless a better one is as near as two cannot be; a worse one gives
 * way. Returns 0 where there is no room.
 */
static int add_marker(const struct vs_search *search, const struct vs_marker *marker,
                      struct vs_marker *markers, size_t capacity, size_t *count)
{
    double least_m2 = search->least_apart_m * search->least_apart_m;
    size_t i;

    for (i = 0; i < *count; i++) {
        double x_m = markers[i].x_m - marker->x_m, y_m = markers[i].y_m - marker->y_m;

        if (x_m * x_m + y_m * y_m >= least_m2)
            continue;
        if (marker->residual_m < markers[i].residual_m)
            markers[i] = *marker;
        return 1;
    }
    if (*count == capacity)
        return 0;
    markers[(*count)++] = *marker;
    return 1;
}

/* The part of a picture as a picture of its own. */
static struct vs_picture cut_out(const struct vs_picture *picture,
                                 const struct vs_window *window, int32_t *left, int32_t *top)
{
    struct vs_picture part;

    *left = cut(window->left, picture->width_px);
    *top = cut(window->top, picture->height_px);
    part.pixels = picture->pixels + (size_t)*top * picture->stride + (size_t)*left;
    part.stride = picture->stride;
    part.width_px = cut(window->right, picture->width_px) - *left;
    part.height_px = cut(window->bottom, picture->height_px) - *top;
    return part;
}

/* How to search a part: the blocks to skip are those of the whole picture, not of a window. */
static const struct vs_search *search_of(const struct vs_search *search,
                                         const struct vs_picture *part,
                                         const struct vs_picture *picture,
                                         struct vs_search *unmasked)
{
    int is_whole = part->width_px == picture->width_px && part->height_px == picture->height_px;

    if (search->outside == NULL || is_whole)
        return search;
    *unmasked = *search;
    unmasked->outside = NULL;
    return unmasked;
}

/* Whether a marker that could be read has been found at a candidate's place. */
static int is_known(const struct vs_search *search, const struct vs_view *view,
                    const struct vs_shape *shape, const struct vs_marker *markers, size_t count)
{
    double least_m2 = search->least_apart_m * search->least_apart_m;
    double pixel[2], place_m[2];
    size_t i;

    pixel[0] = shape->x_px;
    pixel[1] = shape->y_px;
    if (vs_lens_to_plane(&view->lens, pixel, view->height_m, place_m) != VS_OK)
        return 0;
    for (i = 0; i < count; i++) {
        double x_m = markers[i].x_m - place_m[0], y_m = markers[i].y_m - place_m[1];

        if (markers[i].tag >= 0.0 && x_m * x_m + y_m * y_m < least_m2)
            return 1;
    }
    return 0;
}

/* Adds the markers among what the newest scan shows; 0 where there was no room for all. */
static int add_fitted(struct vs_markers *work, const struct vs_search *search,
                      const struct vs_outline *outline, const struct vs_view *view,
                      const int32_t corner[2], struct vs_marker *markers, size_t capacity,
                      size_t *count)
{
    size_t shapes, i, before = *count;
    int is_room;

    vs_shape_find(&work->scan, &search->gate, work->shapes, SHAPES, &shapes);
    is_room = (work->scan.full & VS_MARKERS_FULL_FOUND) == 0;
    for (i = 0; i < shapes; i++) {
        struct vs_shape *shape = &work->shapes[i];
        struct vs_marker marker;

        shape->x_px += corner[0];
        shape->y_px += corner[1];
        if (is_known(search, view, shape, markers, before) ||
            !begin_marker(search, view, shape, &marker) ||
            !vs_outline_fit(outline, view, &marker))
            continue;
        read_marker(outline, view, &marker);
        is_room &= add_marker(search, &marker, markers, capacity, count);
    }
    return is_room;
}

/* The same; less contrast is asked for where the whole picture has little. */
static int add_scanned(struct vs_markers *work, const struct vs_search *search,
                       const struct vs_outline *outline, const struct vs_view *view,
                       const int32_t corner[2], struct vs_marker *markers, size_t capacity,
                       size_t *count)
{
    struct vs_outline pale;

    if (!work->scan.pale)
        return add_fitted(work, search, outline, view, corner, markers, capacity, count);
    pale = *outline;
    pale.least_contrast = search->pale_fit;
    return add_fitted(work, search, &pale, view, corner, markers, capacity, count);
}

/* Where a marker is that has one of its corners there. */
static void begin_at_corner(const struct vs_angle *angle, const struct vs_corner *corner,
                            struct vs_marker *marker)
{
    const double *inward_m = corner->inward_m;
    double c, s;

    memset(marker, 0, sizeof *marker);
    c = marker->ahead_x = inward_m[0] * angle->ahead + inward_m[1] * angle->left;
    s = marker->ahead_y = inward_m[1] * angle->ahead - inward_m[0] * angle->left;
    marker->x_m = corner->place_m[0] - c * angle->x_m + s * angle->y_m;
    marker->y_m = corner->place_m[1] - s * angle->x_m - c * angle->y_m;
    marker->scale = 1.0;
}

static int32_t count_read(const struct vs_marker *markers, size_t count)
{
    int32_t read = 0;
    size_t i;

    for (i = 0; i < count; i++)
        read += markers[i].tag >= 0.0;
    return read;
}

/* Adds those that can be read of which the newest scan shows a corner; 0: no room for all. */
static int add_cornered(struct vs_markers *work, const struct vs_search *search,
                        const struct vs_outline *outline, const struct vs_view *view,
                        const struct vs_picture *part, const int32_t origin[2],
                        struct vs_marker *markers, size_t capacity, size_t *count)
{
    size_t corners = 0, i;
    int is_room = 1, which;

    if (search->corners > 0 && count_read(markers, *count) < search->wanted)
        vs_corners_find(&work->scan, part, search, view, origin, &work->border, work->corners,
                        CORNERS, &corners);
    for (i = 0; i < corners; i++) {
        for (which = 0; which < search->corners; which++) {
            struct vs_marker marker;

            begin_at_corner(&search->corner[which], &work->corners[i], &marker);
            if (!vs_corners_glance(outline, &view->picture, &work->corners[i], &marker) ||
                !vs_outline_fit(outline, view, &marker))
                continue;
            read_marker(outline, view, &marker);
            if (marker.tag >= 0.0 && marker.coverage > LEAST_SEEN)
                is_room &= add_marker(search, &marker, markers, capacity, count);
        }
    }
    return is_room;
}

/* Where in the part are the discs of markers that could be read; returns their number. */
static size_t find_known(struct vs_markers *work, const struct vs_search *search,
                         const struct vs_view *view, const int32_t corner[2],
                         const struct vs_marker *markers, size_t count)
{
    double ahead[2], left[2];
    size_t known = 0, i;

    for (i = 0; i < count && known < SHAPES; i++) {
        struct vs_spot *spot = &work->known[known];

        if (markers[i].tag < 0.0 || vs_edges_slopes(view, &markers[i], ahead, left) != VS_OK)
            continue;
        spot->x_px = markers[i].x_px - corner[0];
        spot->y_px = markers[i].y_px - corner[1];
        spot->radius_px = search->least_apart_m *
                              vs_root(vs_least(ahead[0] * ahead[0] + ahead[1] * ahead[1],
                                               left[0] * left[0] + left[1] * left[1])) - 1.0;
        known += spot->radius_px > 0.0;
    }
    return known;
}

int vs_markers_search(struct vs_markers *work, const struct vs_search *search,
                      const struct vs_outline *outline, const struct vs_view *view,
                      const struct vs_window *window, struct vs_marker *markers,
                      size_t capacity, size_t *count)
{
    int32_t corner[2];
    struct vs_picture part;
    struct vs_search unmasked;
    size_t known;
    int err = vs_outline_check(outline), full, is_room, i;

    for (i = 0; i < VS_MARKERS_AGAIN; i++) {
        if (search->again[i].level_256 < 0 || search->again[i].level_256 > 255)
            return VS_ERR_ARGUMENT;
    }
    if (check_picture(&view->picture) != VS_OK)
        return VS_ERR_ARGUMENT;
    part = cut_out(&view->picture, window, &corner[0], &corner[1]);
    if (err == VS_OK && (part.width_px < 1 || part.height_px < 1))
        return VS_OK;
    search = search_of(search, &part, &view->picture, &unmasked);
    lay_out(work, &view->picture);
    if (err == VS_OK)
        err = vs_scan_picture(&work->scan, &part, search);
    if (err != VS_OK)
        return err;
    full = (int)work->scan.full;
    is_room = add_scanned(work, search, outline, view, corner, markers, capacity, count) &
              add_cornered(work, search, outline, view, &part, corner, markers, capacity, count);
    for (i = 0; i < VS_MARKERS_AGAIN; i++) {
        if (!vs_scan_needs(&work->scan, &search->again[i]))
            continue;
        known = find_known(work, search, view, corner, markers, *count);
        vs_scan_again(&work->scan, &part, search, &search->again[i], work->known, known);
        full |= (int)work->scan.full;
        is_room &= add_scanned(work, search, outline, view, corner, markers, capacity, count);
    }
    return is_room ? full : full | VS_MARKERS_FULL_FOUND;
}

/* Fits a marker from where it is expected. */
static int follow_marker(const struct vs_outline *outline, const struct vs_view *view,
                         const struct vs_marker *expected, struct vs_marker *marker)
{
    *marker = *expected;
    if (outline->words != NULL)
        vs_square_upright(outline->words, marker);
    return vs_outline_fit(outline, view, marker);
}

int vs_markers_follow(const struct vs_outline *first, const struct vs_outline *outline,
                      const struct vs_view *view, struct vs_marker *markers, uint32_t *origin,
                      size_t *count)
{
    size_t known = *count, i;
    int err = vs_outline_check(outline);

    if (err == VS_OK && first != NULL)
        err = vs_outline_check(first);
    if (err == VS_OK)
        err = check_picture(&view->picture);
    *count = 0;
    if (err != VS_OK)
        return err;
    for (i = 0; i < known; i++) {
        struct vs_marker marker;

        if ((first == NULL || !follow_marker(first, view, &markers[i], &marker)) &&
            !follow_marker(outline, view, &markers[i], &marker))
            continue;
        read_marker(outline, view, &marker);
        origin[*count] = (uint32_t)i;
        markers[(*count)++] = marker;
    }
    return VS_OK;
}
