/* SPDX-License-Identifier: MIT */
/* Lines of light and sight under the sanitizers: a crowd is the sum of its bodies, whatever
 * the grid, and no number from outside leads astray. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "vs_rays.h"

#define BODIES 60
#define LINES 400
#define GOALS 5
#define WORDS 100000

static uint32_t seed = 1;

/* A number in [low, high). */
static double draw(double low, double high)
{
    seed = seed * 1664525u + 1013904223u;
    return low + (high - low) * (seed >> 8) / 16777216.0;
}

static struct vs_obstacle draw_body(void)
{
    struct vs_obstacle body;
    double yaw = draw(-3.0, 3.0);

    memset(&body, 0, sizeof body);
    body.x_m = draw(-2.0, 2.0);
    body.y_m = draw(-2.0, 2.0);
    body.z_low_m = draw(-0.1, 0.1);
    body.z_high_m = body.z_low_m + draw(-0.05, 0.3);
    body.radius_m = draw(-0.2, 0.2);
    if (body.radius_m > 0.0)
        return body;
    body.radius_m = 0.0;
    body.half_x_m = draw(0.0, 1.0);
    body.half_y_m = draw(0.0, 0.05);
    body.cosine = cos(yaw);
    body.sine = sin(yaw);
    return body;
}

static void draw_lines(double *starts, double *ends)
{
    int i;

    for (i = 0; i < 3 * LINES; i++) {
        starts[i] = i % 3 == 2 ? draw(-0.1, 0.3) : draw(-3.0, 3.0);
        ends[i] = i % 3 == 2 ? draw(-0.1, 0.3) : draw(-3.0, 3.0);
        if (i % 7 == 0)
            ends[i] = starts[i];
    }
}

static void sort(struct vs_obstacles *scene, const struct vs_obstacle *bodies, uint32_t count,
                 uint32_t *memory)
{
    memset(scene, 0, sizeof *scene);
    scene->bodies = bodies;
    scene->count = count;
    CHECK(vs_obstacles_plan(scene) == VS_OK);
    CHECK(scene->words <= WORDS);
    vs_obstacles_sort(scene, memory);
}

static void crowd_is_the_sum_of_its_bodies(uint32_t count)
{
    static struct vs_obstacle bodies[BODIES];
    static double starts[3 * LINES], ends[3 * LINES], all[LINES], one[LINES], least[LINES];
    static uint8_t blocked[LINES];
    static uint32_t memory[WORDS];
    static int32_t nobody[LINES];
    struct vs_obstacles scene;
    uint32_t i, k;

    for (i = 0; i < count; i++)
        bodies[i] = draw_body();
    draw_lines(starts, ends);
    for (k = 0; k < LINES; k++) {
        least[k] = INFINITY;
        nobody[k] = -1;
    }
    for (i = 0; i < count; i++) {
        sort(&scene, &bodies[i], 1, memory);
        CHECK(vs_rays_nearest(&scene, starts, ends, LINES, nobody, 1, one) == VS_OK);
        for (k = 0; k < LINES; k++)
            least[k] = fmin(least[k], one[k]);
    }
    sort(&scene, bodies, count, memory);
    CHECK(vs_rays_nearest(&scene, starts, ends, LINES, nobody, 1, all) == VS_OK);
    CHECK(vs_rays_blocked(&scene, starts, ends, LINES, NULL, 0, blocked) == VS_OK);
    for (k = 0; k < LINES; k++) {
        CHECK(all[k] == least[k]);
        CHECK(blocked[k] == (least[k] <= 1.0));
    }
}

/* Points in bundles, tight ones and wide ones, see what each alone would see. */
static void bundles_see_what_their_lines_see(uint32_t count, double width_m)
{
    static struct vs_obstacle bodies[BODIES];
    static double points[3 * LINES], goals[3 * LINES], starts[3 * LINES];
    static int32_t skip[2 * LINES];
    static uint8_t seen[GOALS * LINES], blocked[LINES];
    static uint32_t memory[WORDS];
    struct vs_obstacles scene;
    uint32_t i, k;

    for (i = 0; i < count; i++)
        bodies[i] = draw_body();
    draw_lines(starts, points);
    draw_lines(starts, goals);
    for (i = 0; i < 3 * LINES; i++)
        points[i] = points[i - i % 30 + i % 3] + draw(0.0, width_m);
    for (i = 0; i < 2 * LINES; i++)
        skip[i] = (int32_t)draw(-1.0, count);
    sort(&scene, bodies, count, memory);
    CHECK(vs_sight_seen(&scene, points, LINES, goals, GOALS, skip, 2, seen) == VS_OK);
    for (k = 0; k < GOALS; k++) {
        for (i = 0; i < LINES; i++)
            memcpy(&starts[3 * i], &goals[3 * k], 3 * sizeof *goals);
        CHECK(vs_rays_blocked(&scene, points, starts, LINES, skip, 2, blocked) == VS_OK);
        for (i = 0; i < LINES; i++)
            CHECK(seen[i * GOALS + k] == !blocked[i]);
    }
}

static void skipped_bodies_are_not_there(void)
{
    static uint32_t memory[WORDS];
    const double starts[] = {-2, 0, 0.5, -2, 0, 0.5}, ends[] = {2, 0, 0.5, 2, 0, 0.5};
    const int32_t both[] = {0, 1, 1, -1};
    struct vs_obstacle bodies[2];
    struct vs_obstacles scene;
    uint8_t blocked[2];

    memset(bodies, 0, sizeof bodies);
    bodies[0].radius_m = bodies[1].radius_m = 0.25;
    bodies[0].z_high_m = bodies[1].z_high_m = 1.0;
    bodies[1].x_m = 1.0;
    sort(&scene, bodies, 2, memory);
    CHECK(vs_rays_blocked(&scene, starts, ends, 2, both, 2, blocked) == VS_OK);
    CHECK(!blocked[0] && blocked[1]);
    CHECK(vs_rays_blocked(&scene, starts, ends, 1, both, 3, blocked) == VS_ERR_ARGUMENT);
}

static void numbers_from_outside_are_refused(void)
{
    const double wrong[] = {NAN, INFINITY, -INFINITY, 1e300, -1e6};
    const double zero[3] = {0, 0, 0};
    struct vs_obstacle body, bad;
    struct vs_obstacles scene;
    static uint32_t memory[WORDS];
    double end[3], share;
    uint8_t answer;
    size_t i, k;

    memset(&body, 0, sizeof body);
    body.half_x_m = body.half_y_m = body.z_high_m = body.cosine = 1.0;
    for (i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        for (k = 0; k < sizeof body / sizeof(double); k++) {
            bad = body;
            memcpy((char *)&bad + k * sizeof(double), &wrong[i], sizeof(double));
            scene.bodies = &bad;
            scene.count = 1;
            CHECK(vs_obstacles_plan(&scene) == VS_ERR_ARGUMENT);
        }
        sort(&scene, &body, 1, memory);
        for (k = 0; k < 3; k++) {
            memset(end, 0, sizeof end);
            end[k] = wrong[i];
            CHECK(vs_rays_blocked(&scene, zero, end, 1, NULL, 0, &answer) == VS_ERR_ARGUMENT);
            CHECK(vs_rays_nearest(&scene, end, zero, 1, NULL, 0, &share) == VS_ERR_ARGUMENT);
            CHECK(vs_sight_seen(&scene, zero, 1, end, 1, NULL, 0, &answer) ==
                  VS_ERR_ARGUMENT);
            CHECK(vs_sight_seen(&scene, end, 1, zero, 1, NULL, 0, &answer) ==
                  VS_ERR_ARGUMENT);
        }
    }
}

/* Bodies of all sizes at the ends of what is allowed: the grid stays small. */
static void grids_of_extremes_stay_small(void)
{
    static uint32_t memory[WORDS * 20];
    const double starts[] = {-99999, -99999, 0}, ends[] = {99999, 99999, 0};
    struct vs_obstacle bodies[3];
    struct vs_obstacles scene;
    double share;

    memset(bodies, 0, sizeof bodies);
    bodies[0].x_m = bodies[0].y_m = -99999.0;
    bodies[1].x_m = bodies[1].y_m = 99999.0;
    bodies[0].radius_m = bodies[1].radius_m = 1e-9;
    bodies[2].half_x_m = VS_OBSTACLES_LIMIT_M;
    bodies[2].cosine = bodies[2].sine = sqrt(0.5);
    bodies[2].x_m = 1.0;
    memset(&scene, 0, sizeof scene);
    scene.bodies = bodies;
    scene.count = 3;
    CHECK(vs_obstacles_plan(&scene) == VS_OK);
    CHECK(scene.words < sizeof memory / sizeof *memory);
    vs_obstacles_sort(&scene, memory);
    CHECK(vs_rays_nearest(&scene, starts, ends, 1, NULL, 0, &share) == VS_OK);
    CHECK(share == 0.0);
    scene.count = 0;
    CHECK(vs_obstacles_plan(&scene) == VS_OK);
    vs_obstacles_sort(&scene, memory);
    CHECK(vs_rays_nearest(&scene, starts, ends, 1, NULL, 0, &share) == VS_OK);
    CHECK(share > 1.0);
}

int main(int argc, char *argv[])
{
    uint32_t step = argc > 1 ? (uint32_t)strtoul(argv[1], NULL, 10) : 1;
    const double widths[] = {0.0, 0.05, 0.5, 5.0};
    uint32_t i, k;

    for (i = 1; i <= BODIES; i += step)
        crowd_is_the_sum_of_its_bodies(i);
    for (i = 1; i <= BODIES; i += step)
        for (k = 0; k < sizeof widths / sizeof *widths; k++)
            bundles_see_what_their_lines_see(i, widths[k]);
    skipped_bodies_are_not_there();
    numbers_from_outside_are_refused();
    grids_of_extremes_stay_small();
    return 0;
}
