/* SPDX-License-Identifier: MIT */
/* What robots see of each other's lights, under the sanitizers: against all pairs, one by one, with
 * the system's own mathematics. */
#include <math.h>
#include <string.h>

#include "check.h"
#include "vs_leds.h"

#define PI 3.14159265358979323846
#define ROBOTS 30
#define ROW 45 /* of a table of poses: no field is aligned */
#define FIRST 4 /* robots that look are those from here on */
#define LOOKING 20
#define MOST 5
#define WIDTH (1 + 5 * MOST)
#define RADIUS_M 0.035

static const struct vs_pose_fields fields = {ROW, 1, 5, 29, 37, 0};
static uint32_t seed = 1;

struct swarm {
    uint8_t rows[ROBOTS * ROW];
    double at[ROBOTS][3];
    int64_t captures_ns[ROBOTS];
    uint8_t colors[3 * ROBOTS];
    int32_t own[LOOKING];
    struct vs_obstacle bodies[ROBOTS];
    struct vs_obstacles obstacles;
    uint32_t memory[4000];
    struct vs_world world;
    struct vs_scene scene;
    struct vs_leds leds;
};

/* A number in [low, high). */
static double draw(double low, double high)
{
    seed = seed * 1664525u + 1013904223u;
    return low + (high - low) * (seed >> 8) / 16777216.0;
}

/* Some are dark, and some were never seen. */
static void set_robots(struct swarm *s)
{
    uint32_t i, c;

    for (i = 0; i < ROBOTS; i++) {
        uint8_t *row = s->rows + i * ROW;

        s->at[i][0] = draw(-0.8, 0.8);
        s->at[i][1] = draw(-0.8, 0.8);
        s->at[i][2] = draw(-PI, PI);
        s->captures_ns[i] = draw(0.0, 1.0) < 0.1 ? -1 : 5;
        memcpy(row + fields.place, s->at[i], sizeof s->at[i]);
        memcpy(row + fields.capture, &s->captures_ns[i], sizeof s->captures_ns[i]);
        for (c = 0; c < 3; c++)
            s->colors[3 * i + c] = (uint8_t)(draw(0.0, 1.0) < 0.7 ? 0 : draw(1.0, 255.9));
        s->bodies[i].x_m = s->at[i][0];
        s->bodies[i].y_m = s->at[i][1];
        s->bodies[i].z_high_m = 0.076;
        s->bodies[i].radius_m = RADIUS_M;
    }
}

static void begin(struct swarm *s, int occlusions)
{
    uint32_t i;

    memset(s, 0, sizeof *s);
    set_robots(s);
    s->obstacles.bodies = s->bodies;
    s->obstacles.count = ROBOTS;
    CHECK(vs_obstacles_plan(&s->obstacles) == VS_OK && s->obstacles.words <= 4000);
    vs_obstacles_sort(&s->obstacles, s->memory);
    s->world.fields = &fields;
    s->world.robots = s->rows;
    s->world.real = s->world.robots_all = ROBOTS;
    for (i = 0; i < LOOKING; i++)
        s->own[i] = (int32_t)(FIRST + i);
    s->scene.first = s->rows + FIRST * ROW + fields.place;
    s->scene.stride = ROW;
    s->scene.robots = LOOKING;
    s->scene.own = s->own;
    s->scene.obstacles = &s->obstacles;
    s->leds.world = &s->world;
    s->leds.colors = s->colors;
    s->leds.range_m = draw(0.2, 1.5);
    s->leds.view_rad = draw(0.0, 1.0) < 0.5 ? 2.0 * PI : draw(0.5, 6.0);
    s->leds.height_m = 0.04;
    s->leds.occlusions = occlusions;
    s->leds.most = MOST;
}

/* Distance and bearing of a robot that another one sees; negative: it does not. */
static double seen_m(struct swarm *s, uint32_t from, uint32_t to, double *bearing_rad)
{
    double east = s->at[to][0] - s->at[from][0], north = s->at[to][1] - s->at[from][1];
    double ends[2][3] = {{s->at[from][0], s->at[from][1], 0.04}, {s->at[to][0], s->at[to][1], 0.04}};
    const uint8_t *color = s->colors + 3 * to;
    int32_t both[2] = {(int32_t)from, (int32_t)to};
    uint8_t blocked = 0;

    *bearing_rad = remainder(atan2(north, east) - s->at[from][2], 2.0 * PI);
    if (s->leds.occlusions)
        CHECK(vs_rays_blocked(&s->obstacles, ends[0], ends[1], 1, both, 2, &blocked) == VS_OK);
    if (from == to || blocked || s->captures_ns[to] < 0 || !(color[0] || color[1] || color[2]) ||
        hypot(east, north) >= s->leds.range_m || fabs(*bearing_rad) > s->leds.view_rad / 2.0)
        return -1.0;
    return hypot(east, north);
}

static void the_nearest_lights_are_seen(int occlusions)
{
    static struct swarm swarm, *s = &swarm;
    double readings[LOOKING * WIDTH];
    uint32_t i, j, k;

    begin(s, occlusions);
    CHECK(vs_leds_read(&s->leds, &s->scene, readings) == VS_OK);
    for (i = 0; i < LOOKING; i++) {
        const double *reading = readings + i * WIDTH;
        double beyond_m = 0.0, bearing_rad, away_m;

        for (k = 0; k < MOST; k++) {
            double next_m = INFINITY;
            uint32_t next = ROBOTS;

            for (j = 0; j < ROBOTS; j++) {
                away_m = seen_m(s, FIRST + i, j, &bearing_rad);
                if (away_m > beyond_m && away_m < next_m) {
                    next_m = away_m;
                    next = j;
                }
            }
            CHECK((k < reading[0]) == (next < ROBOTS));
            if (next == ROBOTS) {
                CHECK(reading[1 + 5 * k] == 0.0 && reading[3 + 5 * k] == 0.0);
                continue;
            }
            beyond_m = seen_m(s, FIRST + i, next, &bearing_rad);
            CHECK(fabs(reading[1 + 5 * k] - 100.0 * beyond_m) < 1e-10);
            CHECK(fabs(remainder(reading[2 + 5 * k] - bearing_rad, 2.0 * PI)) < 1e-12);
            for (j = 0; j < 3; j++)
                CHECK(reading[3 + 5 * k + j] == s->colors[3 * next + j]);
        }
    }
    s->leds.most = VS_LEDS_MOST + 1;
    CHECK(vs_leds_read(&s->leds, &s->scene, readings) == VS_ERR_ARGUMENT);
}

static void robots_show_their_colors(void)
{
    static const int32_t rows[] = {2, 0};
    static const double levels[] = {1.0, 2.0, 255.0, 0.0, 7.0, 9.0};
    static const uint8_t expected[] = {0, 7, 9, 8, 8, 8, 1, 2, 255};
    uint8_t colors[9];
    struct vs_shine shine = {2, rows, colors};

    memset(colors, 8, sizeof colors);
    CHECK(vs_shine_show(&shine, NULL, levels, NULL) == VS_OK);
    CHECK(memcmp(colors, expected, sizeof colors) == 0);
}

int main(void)
{
    uint32_t i;

    for (i = 0; i < 200; i++)
        the_nearest_lights_are_seen(i % 2);
    robots_show_their_colors();
    return 0;
}
