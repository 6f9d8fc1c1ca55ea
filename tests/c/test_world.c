/* SPDX-License-Identifier: MIT */
/* Last sightings, the crowd of bodies, the simulated tracker, readings and reports on their way,
 * floor and fields, under the sanitizers: against searches from end to end, and the formulas of world/fields.py
 * with the system's own mathematics. */
#include <math.h>
#include <string.h>

#include "check.h"
#include "vs_field.h"
#include "vs_floor.h"
#include "vs_place.h"
#include "vs_places.h"
#include "vs_world.h"

#define PI 3.14159265358979323846
#define ROW 45 /* of a table of poses: no field is aligned */
#define MOST 40
#define HEIGHT_M 0.076

static const struct vs_pose_fields fields = {ROW, 1, 5, 29, 37, 0};
static uint32_t seed = 1;

/* A number in [low, high). */
static double draw(double low, double high)
{
    seed = seed * 1664525u + 1013904223u;
    return low + (high - low) * (seed >> 8) / 16777216.0;
}

static void put(uint8_t *row, uint32_t tag, const double place[3], int64_t capture_ns, int seen)
{
    memset(row, 0, ROW);
    row[0] = (uint8_t)seen;
    memcpy(row + 1, &tag, sizeof tag);
    memcpy(row + 5, place, 3 * sizeof *place);
    memcpy(row + 37, &capture_ns, sizeof capture_ns);
}

static double number(const uint8_t *row, size_t at)
{
    double value;

    memcpy(&value, row + at, sizeof value);
    return value;
}

static void sightings_are_taken_over(void)
{
    uint8_t kept[MOST * ROW], before[MOST * ROW], states[MOST * ROW], virtual[ROW];
    struct vs_world world = {&fields, kept, 10, 12, kept + 12 * ROW, 5};
    double place[3] = {1.0, 2.0, 3.0}, place_before[3] = {1.0, 2.0, 3.0};
    uint32_t i, k, count = (uint32_t)draw(0.0, 30.0), step = 1 + seed % 3;

    for (i = 0; i < 17; i++) /* tags in no order */
        put(kept + i * ROW, i * 7 % 17, place, 5, i != 11);
    memcpy(before, kept, sizeof before);
    for (i = 0; i < count; i++) {
        place[0] = draw(-1.0, 1.0);
        put(states + i * ROW, i * step, place, 9, draw(0.0, 1.0) < 0.7);
    }
    vs_world_update(&world, states, count, 77);
    for (i = 0; i < 17; i++) {
        uint32_t tag = i * 7 % 17;
        const uint8_t *row = kept + i * ROW, *expected = NULL;

        for (k = 0; k < count; k++)
            if (k * step == tag && states[k * ROW])
                expected = states + k * ROW;
        if (i == 10 || i == 11) { /* virtual robots: always seen where they are */
            put(virtual, tag, place_before, 77, 1);
            CHECK(memcmp(row, virtual, ROW) == 0);
        }
        else if (expected)
            CHECK(memcmp(row, expected, ROW) == 0);
        else
            CHECK(row[0] == 0 && memcmp(row + 1, before + i * ROW + 1, ROW - 1) == 0);
    }
}

static void the_crowd_stands_where_it_was_seen(void)
{
    uint8_t kept[MOST * ROW];
    struct vs_world world = {&fields, kept, 6, 6, kept + 6 * ROW, 3};
    struct vs_obstacle bodies[10];
    struct vs_obstacles obstacles;
    double heights_m[9];
    struct vs_crowd crowd = {&world, bodies, heights_m, 100, &obstacles, NULL, 0};
    uint32_t memory[2000], i;
    int64_t captures_ns[] = {1000, 900, 899, -1, 950, 0, 1000, -1, 901};

    memset(bodies, 0, sizeof bodies);
    memset(&obstacles, 0, sizeof obstacles);
    for (i = 0; i < 10; i++)
        bodies[i].radius_m = 0.035;
    for (i = 0; i < 9; i++)
        heights_m[i] = HEIGHT_M;
    bodies[9].z_high_m = 0.5;
    for (i = 0; i < 9; i++) {
        double place[3] = {draw(-1.0, 1.0), draw(-1.0, 1.0), 0.0};

        put(kept + i * ROW, i, place, captures_ns[i], 0);
    }
    obstacles.bodies = bodies;
    obstacles.count = 10;
    CHECK(vs_crowd_stand(&crowd, 1000) == VS_ERR_SPACE);
    CHECK(obstacles.words > 0 && obstacles.words < 2000);
    crowd.memory = memory;
    crowd.room = obstacles.words;
    CHECK(vs_crowd_stand(&crowd, 1000) == VS_OK);
    for (i = 0; i < 9; i++) {
        int is_there = captures_ns[i] >= 900;

        CHECK(bodies[i].x_m == number(kept + i * ROW, 5));
        CHECK(bodies[i].y_m == number(kept + i * ROW, 13));
        CHECK(bodies[i].z_high_m == (is_there ? HEIGHT_M : -1.0));
    }
    CHECK(bodies[9].z_high_m == 0.5 && bodies[9].x_m == 0.0);
    memcpy(kept + 5, &(double){NAN}, sizeof(double));
    CHECK(vs_crowd_stand(&crowd, 1000) == VS_ERR_ARGUMENT);
}

static void the_tracker_sees_what_is_there(int is_wrapping)
{
    uint32_t order[] = {2, 0, 1}, i;
    uint8_t states[3 * ROW];
    double last[9], poses[9], errors[9], before[6] = {0.0};
    struct vs_tracker tracker = {&fields, 3, order, states, last, -1};
    int64_t time_ns;

    memset(states, 7, sizeof states);
    for (time_ns = 1000000000; time_ns <= 1200000000; time_ns += 100000000) {
        for (i = 0; i < 9; i++) {
            poses[i] = draw(-3.0, 3.0);
            errors[i] = draw(-1e-3, 1e-3);
        }
        poses[2] = is_wrapping ? PI : 1.0;
        errors[5] = is_wrapping ? 1e-3 : 0.0;
        for (i = 0; i < 3 && time_ns > 1000000000; i++)
            before[i] = last[3 * i];
        for (i = 0; i < 3 && time_ns > 1000000000; i++)
            before[3 + i] = last[3 * i + 1];
        vs_tracker_see(&tracker, poses, errors, time_ns);
        for (i = 0; i < 3; i++) {
            const double *pose = poses + 3 * order[i], *error = errors + 3 * i;
            const uint8_t *row = states + i * ROW;
            double x = pose[0] + error[0], y = pose[1] + error[1];
            double speed = time_ns == 1000000000
                               ? 0.0
                               : hypot(x - before[i], y - before[3 + i]) / 0.1;

            CHECK(number(row, 5) == x && number(row, 13) == y);
            CHECK(fabs(remainder(number(row, 21) - pose[2] - error[2], 2.0 * PI)) < 1e-14);
            CHECK(number(row, 21) > -PI && number(row, 21) <= PI);
            CHECK(fabs(number(row, 29) - speed) <= 1e-12 * speed);
            CHECK(memcmp(row + 37, &time_ns, sizeof time_ns) == 0);
            CHECK(row[0] == 7 && row[1] == 7);
        }
    }
}

static void readings_travel_as_singles(void)
{
    double fresh[6] = {0.1, -2.0, 1e300, 0.5, 0.25, 3.4e38};
    double offsets[6] = {0.5, 0.5, 0.0, -1.0, 1.0, 1.0};
    double unit[3] = {2.0, 1.0, 0.0}, low[3] = {0.0, -1.0, -INFINITY};
    double high[3] = {1.0, 5.0, INFINITY};
    uint8_t block[2 * 17];
    int64_t captures_ns[4] = {1, 2, 3, 4};
    struct vs_sent sent = {2, 3, VS_NUMBER_F4, block + 1, 17, captures_ns, 2, fresh, NULL, unit,
                           low, high};
    float singles[3];

    memset(block, 9, sizeof block);
    CHECK(vs_sent_renew(&sent, 77) == VS_ERR_ARGUMENT);
    CHECK(block[1] == 9 && captures_ns[0] == 1);
    fresh[2] = 1e-3;
    CHECK(vs_sent_renew(&sent, 77) == VS_OK);
    memcpy(singles, block + 18, sizeof singles);
    CHECK(singles[0] == 0.5f && singles[1] == 0.25f && singles[2] == 3.4e38f);
    CHECK(captures_ns[0] == 77 && captures_ns[1] == 2 && captures_ns[2] == 77);
    CHECK(block[0] == 9 && block[13] == 9 && block[17] == 9 && block[30] == 9);
    sent.offsets = offsets;
    CHECK(vs_sent_renew(&sent, 78) == VS_OK);
    memcpy(singles, block + 1, sizeof singles);
    CHECK(singles[0] == 1.0f && singles[1] == -1.0f && singles[2] == 1e-3f);
    memcpy(singles, block + 18, sizeof singles);
    CHECK(singles[0] == 0.0f && singles[1] == 1.25f);
    fresh[0] = NAN;
    CHECK(vs_sent_renew(&sent, 79) == VS_ERR_ARGUMENT);
}

/* The nearest whole number, of two the even one; nothing is cut off, and noise stays in the type. */
static void readings_travel_as_whole_numbers(void)
{
    static const double given[] = {0.5, 1.5, 2.5, 254.5, 3.4999999, 255.0};
    static const uint8_t expected[] = {0, 2, 2, 254, 3, 255};
    double fresh[6], offsets[6] = {-3.0, 300.0, 0.0, 0.0, 0.0, 0.25}, unit[6], low[6], high[6];
    uint8_t block[6];
    int16_t signed_block[6];
    int64_t capture_ns = 0;
    struct vs_sent sent = {1, 6, VS_NUMBER_U1, block, 6, &capture_ns, 1, fresh, NULL, unit,
                           low, high};
    uint32_t i;

    memcpy(fresh, given, sizeof fresh);
    for (i = 0; i < 6; i++) {
        unit[i] = 1.0;
        low[i] = -INFINITY;
        high[i] = INFINITY;
    }
    CHECK(vs_sent_renew(&sent, 5) == VS_OK && capture_ns == 5);
    CHECK(memcmp(block, expected, sizeof block) == 0);
    sent.offsets = offsets;
    CHECK(vs_sent_renew(&sent, 6) == VS_OK);
    CHECK(block[0] == 0 && block[1] == 255 && block[5] == 255);
    sent.offsets = NULL;
    fresh[0] = -0.25;
    CHECK(vs_sent_renew(&sent, 7) == VS_ERR_ARGUMENT && capture_ns == 6);
    sent.type = VS_NUMBER_I2;
    sent.block = (uint8_t *)signed_block;
    fresh[0] = -32768.0;
    fresh[1] = -1.5;
    fresh[2] = -0.5;
    fresh[3] = -0.51;
    CHECK(vs_sent_renew(&sent, 8) == VS_OK);
    CHECK(signed_block[0] == -32768 && signed_block[1] == -2 && signed_block[2] == 0);
    CHECK(signed_block[3] == -1);
}

static void reports_are_levels_and_growth(void)
{
    float said[4] = {2.0f, 7.0f, NAN, 1e30f};
    double low[2] = {0.0, 0.0}, high[2] = {1.5, 1e7}, last[4] = {1.0, 3.0, 0.5, 2e6};
    double levels[4], growth[4];
    struct vs_heard heard = {2, 2, VS_NUMBER_F4, (const uint8_t *)said, 8, low, high, last,
                             levels, growth};
    uint16_t whole[2] = {65535, 9};

    vs_heard_renew(&heard);
    CHECK(levels[0] == 1.5 && growth[0] == 0.5);
    CHECK(levels[1] == 7.0 && growth[1] == 4.0);
    CHECK(levels[2] == 0.0 && growth[2] == 0.0); /* it has restarted */
    CHECK(levels[3] == 1e7 && growth[3] == 8e6 && last[3] == 1e7);
    heard.type = VS_NUMBER_U2;
    heard.robots = 1;
    heard.block = (const uint8_t *)whole;
    high[0] = 1e5;
    vs_heard_renew(&heard);
    CHECK(levels[0] == 65535.0 && levels[1] == 9.0 && growth[1] == 2.0);
}

/* Robots of a scene: x, y and yaw each. */
static struct vs_scene scene_of(const double *places, uint32_t robots)
{
    struct vs_scene scene;

    memset(&scene, 0, sizeof scene);
    scene.first = (const uint8_t *)places;
    scene.stride = 3 * sizeof *places;
    scene.robots = robots;
    return scene;
}

static void destinations_are_seen_by_robots(void)
{
    double places[] = {1.0, 2.0, 0.5, -1.0, 0.0, 3.0};
    double goals[] = {4.0, 6.0, 0.25, NAN, NAN, NAN}, readings[10];
    struct vs_destinations destinations = {goals};
    struct vs_scene scene = scene_of(places, 2);

    CHECK(vs_destinations_read(&destinations, &scene, readings) == VS_OK);
    CHECK(readings[0] == 4.0 && readings[1] == 6.0 && readings[2] == 0.25);
    CHECK(fabs(readings[3] - 5.0) < 1e-12);
    CHECK(fabs(readings[4] - (atan2(4.0, 3.0) - 0.5)) < 1e-12);
    CHECK(readings[5] == -1.0 && readings[6] == 0.0 && readings[7] == 3.0);
    CHECK(readings[8] == 0.0 && readings[9] == 0.0);
}

/* Who is asked for colours: they are the places, and y is at least 0. */
static int answer(void *whom, const double *points_m, uint32_t n, double *colors)
{
    uint32_t i, c;

    *(uint32_t *)whom += n;
    for (i = 0; i < n; i++) {
        if (points_m[2 * i + 1] < 0.0)
            return VS_ERR_STATE;
        for (c = 0; c < 4; c++)
            colors[4 * i + c] = points_m[2 * i + c % 2];
    }
    return VS_OK;
}

/* Two robots look ahead and to the left of that on a floor that somebody knows; one is turned. */
static void floors_are_asked(void)
{
    uint32_t asked = 0;
    struct vs_floor floor = {NULL, 0, 0, 0, 0, {0.0}, {0.0}, {9, 9, 9, 9}, NULL, answer, &asked};
    double ahead_m[] = {8.0, 8.0}, left_m[] = {0.0, 4.0}, points_m[8], colors[16], greys[4];
    double grey[] = {1.0 / 64.0, 1.0 / 128.0, 1.0 / 64.0};
    struct vs_ground ground = {&floor, 2, ahead_m, left_m, grey, points_m, colors};
    double places[] = {1.0, 2.0, 0.0, 10.0, -20.0, PI / 2.0};
    struct vs_scene scene = scene_of(places, 2);

    CHECK(vs_ground_read(&ground, &scene, greys) == VS_ERR_STATE);
    scene.robots = 1;
    CHECK(vs_ground_read(&ground, &scene, greys) == VS_OK && asked == 6);
    CHECK(greys[0] == (9.0 * 2.0 + 1.0) / 64.0 && greys[1] == (9.0 * 2.0 + 3.0) / 64.0);
    places[0] = -8.0;
    places[1] = 128.0;
    CHECK(vs_ground_read(&ground, &scene, greys) == VS_OK && greys[0] == 1.0);
    places[1] = 0.0;
    places[0] = -10.0;
    CHECK(vs_ground_read(&ground, &scene, greys) == VS_OK && greys[0] == 0.0);
    CHECK(fabs(points_m[0] + 2.0) < 1e-12 && fabs(points_m[3] - 4.0) < 1e-12);
    scene.first += scene.stride;
    places[4] = 20.0;
    CHECK(vs_ground_read(&ground, &scene, greys) == VS_OK);
    CHECK(fabs(points_m[0] - 10.0) < 1e-12 && fabs(points_m[1] - 28.0) < 1e-12);
    CHECK(fabs(points_m[2] - 6.0) < 1e-12 && fabs(points_m[3] - 28.0) < 1e-12);
}

/* A picture of 2 by 2 pixels round (1, 0), a circle over it, a turned rectangle over both. */
static void floors_have_colors(void)
{
    static const uint8_t image[] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12};
    struct vs_zone zones[2] = {{1.5, 0.5, 0.04, 1.0, 0.0, {0.0, 0.0}, {20, 21, 22, 255}},
                               {1.5, 0.5, -1.0, 0.0, 1.0, {0.3, 0.05}, {30, 31, 32, 255}}};
    struct vs_floor floor = {image, 2, 2, 3, 0, {1.0, 0.0}, {2.0, 2.0}, {90, 91, 92, 255}, zones,
                             NULL, NULL};
    double nowhere[] = {0.0}, scratch_m[4];
    struct vs_ground ground = {&floor, 1, nowhere, nowhere, NULL, scratch_m, NULL};
    double points_m[] = {0.5, 0.5, 1.5, 0.5, 0.5, -0.5, 1.0, 0.0, 9.0, -9.0, NAN, 1.0};
    double expected[] = {1.0, 4.0, 7.0, 4.0, 10.0, 1.0}, colors[24];
    double places[] = {1.5, 0.75, 0.0, 1.65, 0.5, 0.0};
    struct vs_scene scene = scene_of(places, 2);
    uint8_t inside[6];
    uint32_t i;

    CHECK(vs_floor_sample(&floor, points_m, 6, colors) == VS_OK);
    for (i = 0; i < 6; i++)
        CHECK(colors[4 * i] == expected[i] && colors[4 * i + 3] == 255.0);
    floor.zones_count = 2;
    CHECK(vs_ground_read(&ground, &scene, colors) == VS_OK);
    CHECK(colors[0] == 30.0 && colors[4] == 20.0 && colors[6] == 22.0);
    floor.image = NULL;
    floor.zones_count = 1;
    CHECK(vs_ground_read(&ground, &scene, colors) == VS_OK);
    CHECK(colors[0] == 90.0 && colors[4] == 20.0);
    vs_zone_contains(&zones[0], points_m, 6, inside);
    CHECK(inside[1] == 1 && inside[0] + inside[2] + inside[3] + inside[4] + inside[5] == 0);
}

/* Concentration at a place in cells, from the nearest four. */
static double between(const struct vs_field *field, double x, double y)
{
    double u = fmin(fmax(x, 0.0), field->columns - 1.0), v = fmin(fmax(y, 0.0), field->rows - 1.0);
    double sum = 0.0;
    uint32_t c, r;

    for (r = 0; r < field->rows; r++)
        for (c = 0; c < field->columns; c++)
            sum += field->cells[r * field->columns + c] * fmax(1.0 - fabs(u - c), 0.0) *
                   fmax(1.0 - fabs(v - r), 0.0);
    return sum;
}

static double total(const struct vs_field *field)
{
    double sum = 0.0;
    uint32_t i;

    for (i = 0; i < field->columns * field->rows; i++)
        sum += field->cells[i];
    return sum * field->cell_m * field->cell_m;
}

static void fields_are_read_and_filled(uint32_t columns, uint32_t rows)
{
    double cells[64], before[64], points_m[20], readings[30], amounts[10], held;
    struct vs_field field = {columns, rows, {-0.3, 0.2}, 0.1, cells};
    struct vs_spread spread = {&field, 3, 0.2, 1.0, before};
    uint32_t i;

    for (i = 0; i < columns * rows; i++)
        cells[i] = draw(0.0, 5.0);
    for (i = 0; i < 20; i++)
        points_m[i] = draw(-1.0, 1.5);
    for (i = 0; i < 10; i++)
        amounts[i] = draw(0.0, 1.0);
    vs_field_read(&field, points_m, 10, readings);
    for (i = 0; i < 10; i++) {
        double x = (points_m[2 * i] + 0.3) / 0.1 - 0.5, y = (points_m[2 * i + 1] - 0.2) / 0.1 - 0.5;
        double east = between(&field, x + 1.0, y) - between(&field, x - 1.0, y);
        double north = between(&field, x, y + 1.0) - between(&field, x, y - 1.0);

        CHECK(fabs(readings[3 * i] - between(&field, x, y)) < 1e-12);
        CHECK(fabs(readings[3 * i + 1] - east / 0.2) < 1e-11);
        CHECK(fabs(readings[3 * i + 2] - north / 0.2) < 1e-11);
    }
    held = total(&field);
    vs_spread_step(&spread);
    CHECK(fabs(total(&field) - held) < 1e-12);
    spread.left = 0.25;
    vs_spread_step(&spread);
    held *= 0.25;
    CHECK(fabs(total(&field) - held) < 1e-12);
    for (i = 0; i < 10; i++)
        held += amounts[i];
    vs_field_deposit(&field, points_m, amounts, 10, 1e9);
    CHECK(fabs(total(&field) - held) < 1e-12 * held);
    vs_field_deposit(&field, points_m, amounts, 10, 2.0);
    vs_field_read(&field, points_m, 10, readings);
    for (i = 0; i < 10; i++)
        CHECK(readings[3 * i] <= 2.0 + 1e-12);
}

/* What a robot leaves it finds; its own axes are those of the gradient. */
static void robots_leave_and_sense(void)
{
    double cells[400], places[6] = {0.0}, readings[6], levels[4] = {0.0, 0.0, 3.0, 0.0};
    double growth[4] = {0.0, 0.5, 9.0, 0.0};
    struct vs_field field = {20, 20, {-1.0, -1.0}, 0.1, cells};
    struct vs_release release = {&field, 0.1, 1e3};
    struct vs_scene scene = scene_of(places, 2);
    double turn_rad = draw(-3.0, 3.0), value[3];
    uint32_t i;

    memset(cells, 0, sizeof cells);
    for (i = 0; i < 6; i++)
        places[i] = draw(-0.8, 0.8);
    places[2] = turn_rad;
    CHECK(vs_field_release(&release, &scene, levels, growth) == VS_OK);
    CHECK(fabs(total(&field) - 0.5 - 0.3) < 1e-12);
    CHECK(vs_field_sense(&field, &scene, readings) == VS_OK);
    vs_field_read(&field, places, 1, value);
    CHECK(readings[0] == value[0]);
    CHECK(fabs(readings[1] - value[1] * cos(turn_rad) - value[2] * sin(turn_rad)) < 1e-9);
    CHECK(fabs(readings[2] - value[2] * cos(turn_rad) + value[1] * sin(turn_rad)) < 1e-9);
    release.most = 0.4;
    CHECK(vs_field_release(&release, &scene, levels, growth) == VS_ERR_ARGUMENT);
}

int main(void)
{
    uint32_t i;

    for (i = 0; i < 300; i++) {
        sightings_are_taken_over();
        the_crowd_stands_where_it_was_seen();
        the_tracker_sees_what_is_there(i % 2);
        fields_are_read_and_filled(1 + i % 8, 1 + i / 8 % 8);
        robots_leave_and_sense();
    }
    readings_travel_as_singles();
    readings_travel_as_whole_numbers();
    reports_are_levels_and_growth();
    destinations_are_seen_by_robots();
    floors_have_colors();
    floors_are_asked();
    return 0;
}
