/* SPDX-License-Identifier: MIT */
/* Devices of published e-pucks under the sanitizers: who hears whom, which LEDs are seen, what is near,
 * by all pairs one by one with the system's own mathematics; and how loop functions are called. */
#include <math.h>
#include <string.h>

#include "check.h"
#include "vs_camera.h"
#include "vs_hearing.h"
#include "vs_cxx_step.h"
#include "vs_proximity.h"

#define PI 3.14159265358979323846
#define ROBOTS 24
#define ROW 45 /* of a table of poses: no field is aligned */
#define MOST 3
#define SIZE 2
#define LEDS 2
#define HEARD (1 + (2 + SIZE) * MOST)
#define SEEN (1 + 5 * MOST)
#define SENSORS 4

static const struct vs_pose_fields fields = {ROW, 1, 5, 29, 37, 0};
static const double leds_m[3 * LEDS] = {0.02, 0.03, 0.0765, -0.036, 0.0, 0.04};
static uint32_t seed = 1;

struct swarm {
    uint8_t rows[ROBOTS * ROW];
    double at[ROBOTS][3];
    int32_t own[ROBOTS];
    struct vs_obstacle bodies[ROBOTS];
    struct vs_obstacles obstacles;
    uint32_t memory[4000];
    struct vs_world world;
    struct vs_scene scene;
};

/* A number in [low, high). */
static double draw(double low, double high)
{
    seed = seed * 1664525u + 1013904223u;
    return low + (high - low) * (seed >> 8) / 16777216.0;
}

static double draw_share(void *state)
{
    (void)state;
    return draw(0.0, 1.0);
}

static void begin(struct swarm *s)
{
    uint32_t i, k;

    memset(s, 0, sizeof *s);
    for (i = 0; i < ROBOTS; i++) {
        for (k = 0; k < 3; k++)
            s->at[i][k] = k < 2 ? draw(-0.4, 0.4) : draw(-PI, PI);
        memcpy(s->rows + i * ROW + fields.place, s->at[i], sizeof s->at[i]);
        s->bodies[i].x_m = s->at[i][0];
        s->bodies[i].y_m = s->at[i][1];
        s->bodies[i].z_high_m = 0.076;
        s->bodies[i].radius_m = 0.035;
        s->own[i] = (int32_t)i;
    }
    s->obstacles.bodies = s->bodies;
    s->obstacles.count = ROBOTS;
    CHECK(vs_obstacles_plan(&s->obstacles) == VS_OK && s->obstacles.words <= 4000);
    vs_obstacles_sort(&s->obstacles, s->memory);
    s->world.fields = &fields;
    s->world.robots = s->rows;
    s->world.real = s->world.robots_all = ROBOTS;
    s->scene.first = s->rows + fields.place;
    s->scene.stride = ROW;
    s->scene.robots = ROBOTS;
    s->scene.own = s->own;
    s->scene.obstacles = &s->obstacles;
}

static int is_blocked(const struct swarm *s, const double *from, const double *to,
                      const int32_t *skip, size_t skips)
{
    uint8_t blocked = 0;

    CHECK(vs_rays_blocked(&s->obstacles, from, to, 1, skip, skips, &blocked) == VS_OK);
    return blocked;
}

/* How far away a robot is that another one hears; negative: it does not. */
static double heard_m(const struct swarm *s, const struct vs_hearing *how, uint32_t to, uint32_t from)
{
    double start[3] = {s->at[to][0], s->at[to][1], 0.052};
    double end[3] = {s->at[from][0], s->at[from][1], 0.052};
    double away_m = hypot(end[0] - start[0], end[1] - start[1]);
    double range_m = how->messages[from].range_m > 0.0 ? how->messages[from].range_m : how->range_m;
    int32_t both[2] = {(int32_t)to, (int32_t)from};

    if (to == from || away_m >= range_m || (how->speaking && how->messages[from].length == 0) ||
        (how->occlusions && is_blocked(s, start, end, both, 2)))
        return -1.0;
    return away_m;
}

/* Each message's first byte is its sender's number; of too many some are heard, nearest or not. */
static void messages_are_heard(int speaking, int shuffled)
{
    static struct swarm swarm, *s = &swarm;
    struct vs_message messages[ROBOTS];
    struct vs_noticed heard[ROBOTS * MOST];
    struct vs_random random = {draw_share, NULL, draw_share, NULL};
    double places_m[3 * ROBOTS], readings[ROBOTS * HEARD];
    uint32_t counts[ROBOTS], i, j, k;
    uint8_t lines[ROBOTS * ROBOTS];
    struct vs_hearing how = {&s->world, messages, &random, 0.3, 2.0 * PI, 0.052, shuffled, speaking,
                             MOST, SIZE, 0.0, 0.035, shuffled, 0.0, 0, places_m, heard, counts,
                             draw(0.0, 1.0) < 0.5 ? lines : NULL};

    begin(s);
    memset(messages, 0, sizeof messages);
    for (i = 0; i < ROBOTS; i++) {
        messages[i].length = (uint8_t)(draw(0.0, 1.0) < 0.5 && speaking ? 0 : 1);
        messages[i].data[0] = (uint8_t)i;
        messages[i].data[1] = 99;
        messages[i].range_m = draw(0.0, 1.0) < 0.5 ? 0.0 : draw(0.05, 0.5);
    }
    CHECK(vs_hearing_read(&how, &s->scene, readings) == VS_OK);
    for (i = 0; i < ROBOTS; i++) {
        const double *reading = readings + i * HEARD;
        uint32_t all = 0, told = 0;

        for (j = 0; j < ROBOTS; j++)
            all += heard_m(s, &how, i, j) >= 0.0;
        CHECK(reading[0] == (all < MOST ? all : MOST));
        for (k = 0; k < MOST; k++) {
            const double *place = reading + 1 + (2 + SIZE) * k;
            uint32_t from = (uint32_t)place[2];
            double away_m = heard_m(s, &how, i, from), range_m = away_m - 0.07;

            if (k >= reading[0]) {
                CHECK(place[0] == 0.0 && place[2] == 0.0);
                continue;
            }
            CHECK(away_m >= 0.0 && place[3] == 0.0 && (told >> from & 1u) == 0);
            told |= 1u << from;
            CHECK(fabs(place[0] - 100.0 * (shuffled ? range_m : fmax(range_m, 0.0))) < 1e-9);
        }
    }
}

/* Whether a robot's camera sees an LED, and how far away along the floor. */
static int is_seen(const struct swarm *s, const struct vs_camera *how, uint32_t robot,
                   uint32_t other, uint32_t led, double *away_m)
{
    const double *at = s->at[other], *led_m = leds_m + 3 * led;
    double camera[3] = {s->at[robot][0], s->at[robot][1], how->height_m};
    double place[3] = {at[0] + led_m[0] * cos(at[2]) - led_m[1] * sin(at[2]),
                       at[1] + led_m[0] * sin(at[2]) + led_m[1] * cos(at[2]), led_m[2]};
    double up_m = place[2] - camera[2];
    int32_t own = (int32_t)robot;

    *away_m = hypot(place[0] - camera[0], place[1] - camera[1]);
    return robot != other && how->colors[3 * (LEDS * other + led)] != 0 &&
           hypot(*away_m, up_m) < how->reach_m && !is_blocked(s, camera, place, &own, 1);
}

static void the_nearest_leds_are_seen(void)
{
    static struct swarm swarm, *s = &swarm;
    uint8_t colors[3 * LEDS * ROBOTS] = {0};
    struct vs_lit lit[LEDS * ROBOTS];
    struct vs_noticed seen[LEDS * ROBOTS], nearest[MOST];
    double readings[ROBOTS * SEEN], away_m, all_m[ROBOTS][3 * LEDS];
    uint32_t counts[ROBOTS], i, j, k, l;
    struct vs_camera how = {&s->world, colors, LEDS, 0, all_m[0], 0.1, NULL, 0.122, 0.2, 0.04, 0, 0.0,
                            MOST, LEDS * ROBOTS, lit, seen, nearest, counts};

    begin(s);
    for (i = 0; i < ROBOTS; i++)
        memcpy(all_m[i], leds_m, sizeof all_m[i]);
    for (i = 0; i < LEDS * ROBOTS; i++)
        colors[3 * i] = (uint8_t)(draw(0.0, 1.0) < 0.5 ? 0 : 1 + i);
    CHECK(vs_camera_read(&how, &s->scene, readings) == VS_OK);
    for (i = 0; i < ROBOTS; i++) {
        const double *reading = readings + i * SEEN;
        uint32_t all = 0, nearer = 0, count = (uint32_t)reading[0];
        double last_m = count ? 0.01 * reading[1 + 5 * (count - 1)] : 0.0;

        for (j = 0; j < ROBOTS; j++)
            for (l = 0; l < LEDS; l++)
                if (is_seen(s, &how, i, j, l, &away_m)) {
                    all++;
                    nearer += away_m < last_m - 1e-9;
                }
        CHECK(count == (all < MOST ? all : MOST) && (count == 0 || nearer == count - 1));
        for (k = 0; k < count; k++) {
            l = (uint32_t)reading[3 + 5 * k] - 1;
            CHECK(is_seen(s, &how, i, l / LEDS, l % LEDS, &away_m));
            CHECK(fabs(reading[1 + 5 * k] - 100.0 * away_m) < 1e-9);
        }
    }
    how.room = 0;
    CHECK(vs_camera_read(&how, &s->scene, readings) == VS_ERR_SPACE);
}

/* A ring reads the nearest body along its lines, and none that touches the line's beginning. */
static void what_is_near_is_felt(int blind)
{
    static struct swarm swarm, *s = &swarm;
    static const double places_rad[SENSORS] = {0.0, PI / 2.0, PI, -PI / 2.0}, fan_rad[] = {0.0};
    struct vs_proximity_ring ring = {SENSORS, 1, places_rad, fan_rad, NULL, 0.036, 0.032,
                                     0.05, 1.0, 100.0, 0, blind, NULL};
    double readings[ROBOTS * SENSORS];
    uint32_t i, k;

    begin(s);
    CHECK(vs_proximity_read(&ring, &s->scene, readings) == VS_OK);
    for (i = 0; i < ROBOTS * SENSORS; i++) {
        const double *at = s->at[i / SENSORS];
        double yaw = at[2] + places_rad[i % SENSORS], line[2][3], share, d, expected;

        for (k = 0; k < 2; k++) {
            line[k][0] = at[0] + (k ? 0.086 : 0.036) * cos(yaw);
            line[k][1] = at[1] + (k ? 0.086 : 0.036) * sin(yaw);
            line[k][2] = 0.032;
        }
        CHECK(vs_rays_nearest(&s->obstacles, line[0], line[1], 1, &s->own[i / SENSORS], 1,
                              &share) == VS_OK);
        d = 0.05 * share;
        expected = fmin(fmax(298.701 * d * d - 36.8961 * d + 1.08212, 0.0), 1.0);
        if (share > 1.0 || (blind && share <= 0.0))
            expected = 0.0;
        CHECK(fabs(readings[i] - 100.0 * expected) < 1e-6);
    }
}

static char called[64];
static double given[3];

static void call(const char *text, size_t size, const double *numbers, size_t count,
                 struct vs_cxx_answer *answer)
{
    CHECK(size < sizeof called && count == 3);
    memcpy(called, text, size);
    called[size] = '\0';
    memcpy(given, numbers, sizeof given);
    answer->text_size = size % 2;
}

static void loop_functions_are_told_the_clock_and_the_places(void)
{
    uint32_t note[3] = {7, 0, 5};
    uint8_t row[ROW] = {0}, colors[2] = {1, 2}, told[2] = {1, 2};
    double place[3] = {1.0, -2.0, 0.5}, places[3];
    struct vs_world world = {&fields, row, 1, 1, NULL, 0};
    struct vs_cxx loop = {call, {NULL, 0, NULL, 0}, note, {40, 41, 42, 43}, &world, places, colors,
                           told, 2, 1, NULL, NULL};

    memcpy(row + fields.place, place, sizeof place);
    CHECK(vs_cxx_step(&loop, VS_CXX_PRE_STEP, 12, 4294967295u) == VS_OK);
    CHECK(strcmp(called, "PreStep\nclock\t4294967295") == 0 && memcmp(given, place, 24) == 0);
    CHECK(note[0] == 12 && note[1] == 0 && note[2] == 5);
    CHECK(vs_cxx_step(&loop, VS_CXX_IS_FINISHED, 13, 0) == VS_OK);
    CHECK(strcmp(called, "IsExperimentFinished\nclock\t0") == 0);
    CHECK(vs_cxx_step(&loop, VS_CXX_POST_STEP, 13, 10) == VS_CXX_SAID);
    colors[1] = 3;
    CHECK(vs_cxx_step(&loop, VS_CXX_POST_STEP, 14, 11) == VS_CXX_SHINES && note[0] == 13);
}

int main(void)
{
    int i;

    for (i = 0; i < 100; i++) {
        messages_are_heard(i % 2, i / 2 % 2);
        the_nearest_leds_are_seen();
        what_is_near_is_felt(i % 2);
    }
    loop_functions_are_told_the_clock_and_the_places();
    return 0;
}
