/* SPDX-License-Identifier: MIT */
/* Light sensors under the sanitizers, against the formulas of world/sensors/light.py with the
 * system's own exp, atan2, sin and cos. */
#include <math.h>
#include <string.h>

#include "check.h"
#include "vs_light.h"
#include "vs_math.h"

#define PI 3.14159265358979323846
#define ROBOTS 40
#define LIGHTS 5
#define SENSORS 8
#define STEP (SENSORS + 3)
#define RADIUS_M 0.036
#define HEIGHT_M 0.032
#define NEAREST_M 0.01

static uint32_t seed = 1;

/* A number in [low, high). */
static double draw(double low, double high)
{
    seed = seed * 1664525u + 1013904223u;
    return low + (high - low) * (seed >> 8) / 16777216.0;
}

static void decay_is_the_exponential(void)
{
    int i;

    for (i = 0; i < 100000; i++) {
        double x = -draw(0.0, i % 2 ? 700.0 : 6.0);
        double expected = exp(x);

        CHECK(fabs(vs_decay(x) - expected) <= 1e-15 * expected);
    }
    CHECK(vs_decay(0.0) == 1.0);
    CHECK(vs_decay(-701.0) == 0.0 && vs_decay(-INFINITY) == 0.0);
    CHECK(vs_decay(1.0) == 1.0 && vs_decay(NAN) == 1.0);
}

static void bearing_is_the_arctangent(void)
{
    const double some[] = {-2.0, -1.0, -0.0, 0.0, 1.0, 2.0};
    int i, k;

    for (i = 0; i < 100000; i++) {
        double y = draw(-3.0, 3.0), x = draw(-3.0, 3.0);

        CHECK(fabs(vs_bearing(y, x) - atan2(y, x)) <= 5e-16);
    }
    for (i = 0; i < 6; i++)
        for (k = 0; k < 6; k++)
            if (some[i] != 0.0)
                CHECK(fabs(vs_bearing(some[i], some[k]) - atan2(some[i], some[k])) <= 5e-16);
    CHECK(vs_bearing(0.0, 0.0) == 0.0);
    CHECK(vs_bearing(0.0, 1.0) == 0.0 && fabs(vs_bearing(0.0, -1.0) - PI) < 1e-15);
}

struct scene {
    struct vs_obstacle bodies[ROBOTS];
    struct vs_obstacles obstacles;
    uint32_t memory[10000];
    double places[ROBOTS][3];
    uint8_t rows[ROBOTS * 29]; /* the places in a table, in no alignment */
    int32_t own[ROBOTS];
    struct vs_light lights[LIGHTS];
    double angles_rad[SENSORS];
    struct vs_scene at;
    struct vs_light_ring ring;
};

static void set_ring(struct scene *s, uint32_t formula)
{
    int k;

    for (k = 0; k < SENSORS; k++)
        s->angles_rad[k] = draw(-PI, PI);
    s->ring.formula = formula;
    s->ring.sensors = SENSORS;
    s->ring.angles_rad = s->angles_rad;
    s->ring.radius_m = RADIUS_M;
    s->ring.height_m = HEIGHT_M;
    s->ring.nearest_m = NEAREST_M;
    s->ring.range_m = draw(0.5, 4.0);
    s->ring.view_rad = seed % 2 ? draw(1.0, 6.0) : 2.0 * PI;
    s->ring.most = seed % 4 < 2 ? 1.0 : INFINITY;
    s->ring.gain = draw(1.0, 4096.0);
    s->ring.step = STEP;
}

static void draw_scene(struct scene *s, uint32_t formula)
{
    int i, axis;

    memset(s, 0, sizeof *s);
    for (i = 0; i < ROBOTS; i++) {
        for (axis = 0; axis < 3; axis++)
            s->places[i][axis] = axis == 2 ? draw(-PI, PI) : draw(-1.0, 1.0);
        memcpy(s->rows + 29 * i + 1, s->places[i], sizeof s->places[i]);
        s->bodies[i].x_m = s->places[i][0];
        s->bodies[i].y_m = s->places[i][1];
        s->bodies[i].z_high_m = 0.076;
        s->bodies[i].radius_m = 0.035;
        s->own[i] = i;
    }
    for (i = 0; i < LIGHTS; i++) {
        for (axis = 0; axis < 3; axis++)
            s->lights[i].at_m[axis] = axis == 2 ? draw(0.02, 0.5) : draw(-1.5, 1.5);
        s->lights[i].intensity = draw(0.1, 2.0);
    }
    s->obstacles.bodies = s->bodies;
    s->obstacles.count = ROBOTS;
    CHECK(vs_obstacles_plan(&s->obstacles) == VS_OK);
    CHECK(s->obstacles.words <= sizeof s->memory / sizeof *s->memory);
    vs_obstacles_sort(&s->obstacles, s->memory);
    s->at.first = s->rows + 1;
    s->at.stride = 29;
    s->at.robots = ROBOTS;
    s->at.own = s->own;
    s->at.lights = s->lights;
    s->at.lights_count = LIGHTS;
    s->at.obstacles = &s->obstacles;
    set_ring(s, formula);
}

static int is_blocked(const struct scene *s, const double *from_m, const double *to_m, int32_t own)
{
    uint8_t blocked;

    CHECK(vs_rays_blocked(&s->obstacles, from_m, to_m, 1, &own, 1, &blocked) == VS_OK);
    return blocked;
}

/* Of an angle, however often it goes round: how far off straight ahead. */
static double off_axis(double angle_rad)
{
    return fabs(remainder(angle_rad, 2.0 * PI));
}

static double epuck(const struct scene *s, const struct vs_light *light, int robot, int sensor,
                    int occlusions)
{
    double x_m = light->at_m[0] - s->places[robot][0], y_m = light->at_m[1] - s->places[robot][1];
    double centre_m[3] = {s->places[robot][0], s->places[robot][1], 0.0};
    double distance_m = sqrt(x_m * x_m + y_m * y_m + light->at_m[2] * light->at_m[2]);
    double off_rad =
        off_axis(atan2(y_m, x_m) - s->places[robot][2] - s->angles_rad[sensor]);

    if (distance_m > 2.5 * light->intensity || distance_m > s->ring.range_m ||
        off_rad > 0.5 * s->ring.view_rad || off_rad > 0.5 * PI ||
        (occlusions && is_blocked(s, centre_m, light->at_m, robot)))
        return 0.0;
    return exp(-2.0 * distance_m / light->intensity) * (1.0 - 2.0 / PI * off_rad);
}

static double thesis(const struct scene *s, const struct vs_light *light, int robot, int sensor,
                     int occlusions)
{
    double heading_rad = s->places[robot][2] + s->angles_rad[sensor];
    double from_m[3] = {s->places[robot][0] + RADIUS_M * cos(heading_rad),
                        s->places[robot][1] + RADIUS_M * sin(heading_rad), HEIGHT_M};
    double x_m = light->at_m[0] - from_m[0], y_m = light->at_m[1] - from_m[1];
    double z_m = light->at_m[2] - from_m[2];
    double squared = x_m * x_m + y_m * y_m + z_m * z_m;

    if (squared > s->ring.range_m * s->ring.range_m ||
        off_axis(atan2(y_m, x_m) - heading_rad) > 0.5 * s->ring.view_rad ||
        (occlusions && is_blocked(s, from_m, light->at_m, -1)))
        return 0.0;
    return light->intensity * light->intensity / fmax(squared, NEAREST_M * NEAREST_M);
}

static void readings_are_the_formulas(uint32_t formula, int occlusions)
{
    static struct scene scene;
    static double readings[ROBOTS * STEP];
    int i, k, l;

    draw_scene(&scene, formula);
    for (i = 0; i < ROBOTS * STEP; i++)
        readings[i] = -7.0;
    scene.ring.occlusions = occlusions;
    CHECK(vs_light_read(&scene.ring, &scene.at, readings) == VS_OK);
    for (i = 0; i < ROBOTS; i++)
        for (k = 0; k < STEP; k++) {
            double expected = k < SENSORS ? 0.0 : -7.0;

            for (l = 0; l < LIGHTS && k < SENSORS; l++)
                expected += formula == VS_LIGHT_AT_CENTRE
                                ? epuck(&scene, &scene.lights[l], i, k, occlusions)
                                : thesis(&scene, &scene.lights[l], i, k, occlusions);
            if (k < SENSORS)
                expected = fmin(expected, scene.ring.most) * scene.ring.gain;
            CHECK(fabs(readings[i * STEP + k] - expected) <=
                  1e-13 * (fabs(expected) + scene.ring.gain));
        }
}

static void what_cannot_be_is_refused(void)
{
    static struct scene scene;
    double readings[ROBOTS * STEP];
    uint32_t formula;

    for (formula = 0; formula < 2; formula++) {
        draw_scene(&scene, formula);
        scene.lights[1].at_m[0] = 1e6;
        scene.lights[1].intensity = 1e9;
        scene.ring.range_m = 1e9;
        scene.ring.occlusions = 1;
        CHECK(vs_light_read(&scene.ring, &scene.at, readings) == VS_ERR_ARGUMENT);
    }
    scene.ring.sensors = VS_LIGHT_SENSORS_MAX + 1;
    CHECK(vs_light_read(&scene.ring, &scene.at, readings) == VS_ERR_ARGUMENT);
}

int main(void)
{
    uint32_t i;

    decay_is_the_exponential();
    bearing_is_the_arctangent();
    for (i = 0; i < 200; i++)
        readings_are_the_formulas(i % 2, i % 4 < 2);
    what_cannot_be_is_refused();
    return 0;
}
