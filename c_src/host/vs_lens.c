/* SPDX-License-Identifier: MIT */
#include "vs_lens.h"

#define NEAREST_M 1e-6
#define INVERSION_STEPS 12
#define INVERSION_TOLERANCE 1e-20

static void distort(const struct vs_lens *lens, double x, double y, double seen[2])
{
    const double *k = lens->distortion;
    double r2 = x * x + y * y;
    double radial = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
    double xy = 2.0 * x * y;

    seen[0] = x * radial + k[2] * xy + k[3] * (r2 + 2.0 * x * x);
    seen[1] = y * radial + k[2] * (r2 + 2.0 * y * y) + k[3] * xy;
}

int vs_lens_project(const struct vs_lens *lens, const double point_m[3], double pixel[2])
{
    const double *r = lens->rotation;
    double x = point_m[0] - lens->position_m[0];
    double y = point_m[1] - lens->position_m[1];
    double z = point_m[2] - lens->position_m[2];
    double depth = r[6] * x + r[7] * y + r[8] * z;
    double per_depth;
    double seen[2];

    if (!(depth > NEAREST_M))
        return VS_ERR_ARGUMENT;
    per_depth = 1.0 / depth;
    distort(lens, (r[0] * x + r[1] * y + r[2] * z) * per_depth,
            (r[3] * x + r[4] * y + r[5] * z) * per_depth, seen);
    pixel[0] = lens->fx_px * seen[0] + lens->cx_px;
    pixel[1] = lens->fy_px * seen[1] + lens->cy_px;
    return VS_OK;
}

/* Inverts the distortion by Newton's method; its Jacobian (a b; b d) is symmetric. */
static void undistort(const struct vs_lens *lens, const double seen[2], double ideal[2])
{
    const double *k = lens->distortion;
    double x = seen[0];
    double y = seen[1];
    int step;

    for (step = 0; step < INVERSION_STEPS; step++) {
        double r2 = x * x + y * y;
        double radial = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
        double slope = 2.0 * (k[0] + r2 * (2.0 * k[1] + r2 * 3.0 * k[4]));
        double a = radial + slope * x * x + 2.0 * k[2] * y + 6.0 * k[3] * x;
        double b = slope * x * y + 2.0 * (k[2] * x + k[3] * y);
        double d = radial + slope * y * y + 6.0 * k[2] * y + 2.0 * k[3] * x;
        double scale = 1.0 / (a * d - b * b);
        double now[2];
        double dx, dy;

        distort(lens, x, y, now);
        dx = seen[0] - now[0];
        dy = seen[1] - now[1];
        x += (d * dx - b * dy) * scale;
        y += (a * dy - b * dx) * scale;
        if (dx * dx + dy * dy < INVERSION_TOLERANCE)
            break;
    }
    ideal[0] = x;
    ideal[1] = y;
}

int vs_lens_to_plane(const struct vs_lens *lens, const double pixel[2], double height_m,
                     double point_m[2])
{
    const double *r = lens->rotation;
    double seen[2], ideal[2];
    double down, reach;

    seen[0] = (pixel[0] - lens->cx_px) / lens->fx_px;
    seen[1] = (pixel[1] - lens->cy_px) / lens->fy_px;
    undistort(lens, seen, ideal);
    down = r[2] * ideal[0] + r[5] * ideal[1] + r[8];
    reach = (height_m - lens->position_m[2]) / down;
    if (!(reach > NEAREST_M && reach < 1e6))
        return VS_ERR_ARGUMENT;
    point_m[0] = lens->position_m[0] + reach * (r[0] * ideal[0] + r[3] * ideal[1] + r[6]);
    point_m[1] = lens->position_m[1] + reach * (r[1] * ideal[0] + r[4] * ideal[1] + r[7]);
    return VS_OK;
}

int vs_lens_map(const struct vs_view *view, double x_px, double y_px, double place_m[2],
                double map[4])
{
    static const double step[4][2] = {{0.5, 0.0}, {-0.5, 0.0}, {0.0, 0.5}, {0.0, -0.5}};
    double near_m[4][2], pixel[2];
    int i;

    for (i = 0; i < 4; i++) {
        pixel[0] = x_px + step[i][0];
        pixel[1] = y_px + step[i][1];
        if (vs_lens_to_plane(&view->lens, pixel, view->height_m, near_m[i]) != VS_OK)
            return 0;
    }
    for (i = 0; i < 2; i++) {
        place_m[i] = 0.25 * (near_m[0][i] + near_m[1][i] + near_m[2][i] + near_m[3][i]);
        map[2 * i] = near_m[0][i] - near_m[1][i];
        map[2 * i + 1] = near_m[2][i] - near_m[3][i];
    }
    return 1;
}
