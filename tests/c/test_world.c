/* SPDX-License-Identifier: MIT */
/* Last sightings, the crowd of bodies, the simulated tracker, readings on their way and fields,
 * under the sanitizers: against searches from end to end, and the formulas of world/fields.py
 * with the system's own mathematics. */
#include <math.h>
#include <string.h>

#include "check.h"
#include "vs_field.h"
#include "vs_scene.h"
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
    uint8_t kept[MOST * ROW], before[MOST * ROW], states[MOST * ROW];
    struct vs_world world = {&fields, kept, 10, 12, kept + 12 * ROW, 5};
    double place[3] = {1.0, 2.0, 3.0};
    uint32_t i, k, count = (uint32_t)draw(0.0, 30.0), step = 1 + seed % 3;

    for (i = 0; i < 17; i++) /* tags in no order */
        put(kept + i * ROW, i * 7 % 17, place, 5, 1);
    memcpy(before, kept, sizeof before);
    for (i = 0; i < count; i++) {
        place[0] = draw(-1.0, 1.0);
        put(states + i * ROW, i * step, place, 9, draw(0.0, 1.0) < 0.7);
    }
    vs_world_update(&world, states, count);
    for (i = 0; i < 17; i++) {
        uint32_t tag = i * 7 % 17;
        const uint8_t *row = kept + i * ROW, *expected = NULL;

        for (k = 0; k < count; k++)
            if (k * step == tag && states[k * ROW])
                expected = states + k * ROW;
        if (i == 10 || i == 11) /* virtual robots */
            CHECK(memcmp(row, before + i * ROW, ROW) == 0);
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
    struct vs_crowd crowd = {&world, bodies, HEIGHT_M, 100, &obstacles, NULL, 0};
    uint32_t memory[2000], i;
    int64_t captures_ns[] = {1000, 900, 899, -1, 950, 0, 1000, -1, 901};

    memset(bodies, 0, sizeof bodies);
    memset(&obstacles, 0, sizeof obstacles);
    for (i = 0; i < 10; i++)
        bodies[i].radius_m = 0.035;
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
    struct vs_sent sent = {2, 3, block + 1, 17, captures_ns, 2, fresh, NULL, unit, low, high};
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
    vs_field_diffuse(&field, 0.2, before);
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

int main(void)
{
    uint32_t i;

    for (i = 0; i < 300; i++) {
        sightings_are_taken_over();
        the_crowd_stands_where_it_was_seen();
        the_tracker_sees_what_is_there(i % 2);
        fields_are_read_and_filled(1 + i % 8, 1 + i / 8 % 8);
    }
    readings_travel_as_singles();
    return 0;
}
