/* SPDX-License-Identifier: MIT */
/*
 * The floor of lab and simulation: crowds that are thrown together at random, with every
 * array as small as its header allows, so that the sanitizers see each step beyond it.
 */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "robot_check.h"
#include "vs_contacts.h"
#include "vs_math.h"
#include "vs_physics.h"
#include "vs_ring.h"

#define RADIUS_M 0.035
#define RAYS 3
#define EPUCK {0.041 * VS_PI / 1000.0, 0.5 / 0.053, 0.0, 1.0, 10000, 1000}

struct floor {
    struct vs_near near;
    struct vs_contacts contacts;
    struct vs_physics physics;
    double *radii_m;
    double *box_rows;
    struct vs_drive *drives;
};

static void *room(size_t count, size_t size)
{
    void *made = calloc(count > 0 ? count : 1, size);

    CHECK(made != NULL);
    return made;
}

static void build(struct floor *f, uint32_t robots, uint32_t bodies, uint32_t boxes)
{
    uint32_t pairs = robots * (bodies + boxes);
    uint32_t i;

    memset(f, 0, sizeof *f);
    f->near.robots = robots;
    f->near.bodies = bodies;
    f->near.boxes = boxes;
    f->near.radii_m = f->radii_m = room(bodies, sizeof(double));
    f->near.box_rows = f->box_rows = room(boxes, VS_BOX_NUMBERS * sizeof(double));
    f->near.searched_m = room(bodies, 2 * sizeof(double));
    f->near.pairs = room(pairs, sizeof(struct vs_pair));
    f->near.next = room(bodies, sizeof(uint32_t));
    f->near.heads = room(bodies, 2 * sizeof(uint32_t));
    f->contacts.near = &f->near;
    f->contacts.now = room(pairs, sizeof(struct vs_contact));
    f->contacts.before = room(pairs, sizeof(struct vs_contact));
    f->contacts.moved_m = room(bodies, 2 * sizeof(double));
    f->contacts.newest = room(bodies, sizeof(uint32_t));
    f->physics.contacts = &f->contacts;
    f->physics.poses = room(bodies, 3 * sizeof(double));
    f->physics.mobility = room(bodies, sizeof(double));
    f->contacts.mobility = f->physics.mobility;
    f->physics.wheels_m_s = room(robots, 2 * sizeof(double));
    f->physics.commands = room(robots, 2 * sizeof(int16_t));
    f->physics.rolled_ns = room(robots, sizeof(int64_t));
    f->physics.arcs = room(robots, 2 * sizeof(double));
    f->physics.drives = f->drives = room(robots, sizeof *f->drives);
    f->near.reach_m = 0.11;
    for (i = 0; i < robots; i++) {
        static const struct vs_drive drives[2] = {EPUCK, {1e-3, 0.5 / 0.09, 1.0, 0.1, 0, 300}};

        f->drives[i] = drives[i % 2];
    }
}

static void tear_down(struct floor *f)
{
    free(f->radii_m);
    free(f->box_rows);
    free(f->near.searched_m);
    free(f->near.pairs);
    free(f->near.next);
    free(f->near.heads);
    free(f->contacts.now);
    free(f->contacts.before);
    free(f->contacts.moved_m);
    free(f->contacts.newest);
    free(f->physics.poses);
    free(f->physics.mobility);
    free(f->physics.wheels_m_s);
    free(f->physics.commands);
    free(f->physics.rolled_ns);
    free(f->physics.arcs);
    free(f->drives);
}

static double draw_between(uint32_t *random, double low, double high)
{
    return low + (high - low) * draw(random, 1000001) / 1e6;
}

static void scatter(struct floor *f, uint32_t *random, double half_m)
{
    uint32_t b;

    for (b = 0; b < f->near.bodies; b++) {
        f->radii_m[b] = b < f->near.robots ? RADIUS_M : draw_between(random, 0.01, 0.1);
        f->physics.poses[3 * b] = draw_between(random, -half_m, half_m);
        f->physics.poses[3 * b + 1] = draw_between(random, -half_m, half_m);
        f->physics.poses[3 * b + 2] = draw_between(random, -9.0, 9.0);
    }
    for (b = 0; b < f->near.boxes; b++) {
        double *row = f->box_rows + VS_BOX_NUMBERS * b;
        double yaw_rad = draw_between(random, -3.0, 3.0);

        row[0] = draw_between(random, -2.0 * half_m, 2.0 * half_m);
        row[1] = draw_between(random, -2.0 * half_m, 2.0 * half_m);
        vs_sin_cos(yaw_rad, &row[3], &row[2]);
        row[4] = draw_between(random, 0.005, 0.1);
        row[5] = draw_between(random, 0.005, 0.1);
    }
    vs_physics_init(&f->physics, 0);
}

/* Of two sensors each stands in for one of an e-puck's, and both for another one. */
static void check_stand_in(struct vs_rings *rings, struct vs_ring *ring, const struct floor *f)
{
    static const uint8_t stand_in[VS_RING_SENSORS] = {1, 0, 2, 3};
    uint32_t sensors = VS_RING_SENSORS * f->near.robots;
    double *noise = room(sensors, sizeof(double));
    uint32_t i;

    rings->clean = room(sensors, sizeof(double));
    rings->raw = room(sensors, sizeof(int16_t));
    ring->stand_in = stand_in;
    vs_rings_read(rings, f->physics.poses, noise);
    for (i = 0; i < sensors; i += VS_RING_SENSORS) {
        const int16_t *raw = rings->raw + i;

        CHECK(raw[0] >= 60 && raw[2] >= 60 && raw[1] == 0 && raw[7] == 0);
        CHECK(raw[3] == (raw[0] > raw[2] ? raw[0] : raw[2]));
    }
    free(rings->clean);
    free(rings->raw);
    free(noise);
}

static void check_ring(struct floor *f)
{
    static const double from[2 * RAYS] = {0.03, 0.03, 0.03, 0.0, 0.0, 0.0};
    static const double side[2 * RAYS] = {0.0, 0.0, 0.0, 0.031, 0.031, 0.031};
    static const double x[2 * RAYS] = {0.8, 1.0, 0.8, -0.6, 0.0, 0.6};
    static const double y[2 * RAYS] = {-0.6, 0.0, 0.6, 0.8, 1.0, 0.8};
    static const double response[RAYS] = {0.5, 1.0, 0.5};
    static const double table_m[3] = {0.0, 0.01, 0.07};
    static const double table_raw[3] = {4095.0, 1000.0, 60.0};
    struct vs_ring ring = {2, RAYS, from, side, x, y, response, 3, table_m, table_raw,
                           NULL};
    const struct vs_ring **each = room(f->near.robots, sizeof *each);
    uint32_t sensors = VS_RING_SENSORS * f->near.robots;
    double *distances_m = room(sensors * RAYS, sizeof(double));
    struct vs_rings rings = {each, &f->near, NULL, NULL, distances_m, NULL, NULL};
    double *raw = room(sensors, sizeof(double));
    uint32_t s;

    for (s = 0; s < f->near.robots; s++)
        each[s] = &ring;
    vs_rings_distances(&rings, f->physics.poses);
    vs_ring_readings(&ring, distances_m, sensors, raw);
    for (s = 0; s < sensors; s++)
        CHECK(raw[s] >= 60.0 && raw[s] <= 4095.0);
    for (s = 0; s < sensors * RAYS; s++)
        CHECK(distances_m[s] >= 0.0);
    check_stand_in(&rings, &ring, f);
    free(distances_m);
    free(raw);
    free(each);
}

static void check_poses(const struct floor *f)
{
    uint32_t b;
    uint32_t i;

    for (b = 0; b < f->near.bodies; b++) {
        for (i = 0; i < 3; i++)
            CHECK(f->physics.poses[3 * b + i] > -100.0 && f->physics.poses[3 * b + i] < 100.0);
        CHECK(fabs(f->physics.poses[3 * b + 2]) <= 3.1415926535897936);
    }
}

static void test_any_crowd(uint32_t seed)
{
    uint32_t random = seed * 2654435761u + 1u;
    uint32_t robots = draw(&random, 12);
    struct floor f;
    int64_t time_ns = 0;
    int tick;

    build(&f, robots, robots + draw(&random, 4), draw(&random, 6));
    scatter(&f, &random, draw_between(&random, 0.0, 0.6));
    for (tick = 0; tick < 60; tick++) {
        time_ns += 1 + (int64_t)draw(&random, 40000000);
        if (robots > 0)
            vs_physics_drive(&f.physics, draw(&random, robots), (int)draw(&random, 4000) - 2000,
                             (int)draw(&random, 4000) - 2000, time_ns - 5000000);
        vs_physics_advance(&f.physics, time_ns);
        check_poses(&f);
        check_ring(&f);
    }
    tear_down(&f);
}

/* One tick parts whatever overlaps, unless it is wedged between things that never move. */
static void test_a_pile_comes_apart(void)
{
    uint32_t random = 7;
    struct floor f;
    int64_t tick;
    uint32_t a;
    uint32_t b;

    build(&f, 20, 20, 0);
    scatter(&f, &random, 0.1);
    for (tick = 1; tick <= 20; tick++)
        vs_physics_tick(&f.physics, tick * VS_TICK_NS);
    for (a = 0; a < 20; a++)
        for (b = 0; b < a; b++)
            CHECK(hypot(f.physics.poses[3 * a] - f.physics.poses[3 * b],
                        f.physics.poses[3 * a + 1] - f.physics.poses[3 * b + 1]) >
                  2.0 * RADIUS_M - 1e-4);
    tear_down(&f);
}

/* Found by fuzzing: a robot that begins between two bodies that stand closer than it is wide can
 * leave neither. The pushes that grow from tick to tick must not throw it out of the arena. */
static void test_a_wedged_robot_is_not_thrown_away(uint32_t seed)
{
    uint32_t random = seed * 2654435761u + 1u;
    struct floor f;
    int64_t tick;
    int i;

    build(&f, 1, 3, 0);
    scatter(&f, &random, 0.0);
    for (i = 0; i < 3; i++) {
        f.physics.poses[3 * i] = draw_between(&random, -1e-5, 1e-5);
        f.physics.poses[3 * i + 1] = 0.02 * (i == 2 ? -1 : i);
    }
    for (tick = 1; tick <= 300; tick++) {
        vs_physics_tick(&f.physics, tick * VS_TICK_NS);
        CHECK(hypot(f.physics.poses[0], f.physics.poses[1]) < 1.0);
    }
    tear_down(&f);
}

/* A walk in small steps never leaves a pair out that is near enough to matter. */
static void test_pairs_hold_until_somebody_has_moved_far(uint32_t seed)
{
    uint32_t random = seed * 2654435761u + 1u, bodies = 2 + draw(&random, 11);
    struct floor f;
    uint32_t a, b, i;
    int step;

    build(&f, bodies, bodies, 1);
    scatter(&f, &random, 0.5);
    for (step = 0; step < 30; step++) {
        const double *poses = f.physics.poses;

        for (i = 0; i < 3 * bodies; i++)
            f.physics.poses[i] += i % 3 < 2 ? draw_between(&random, -0.0013, 0.0013) : 0.0;
        vs_near_update(&f.near, poses, 3);
        for (i = 0, a = 0; a < bodies; a++) {
            for (b = 0; b < bodies; b++) {
                double apart_m = hypot(poses[3 * a] - poses[3 * b],
                                       poses[3 * a + 1] - poses[3 * b + 1]);

                while (i < f.near.count && (f.near.pairs[i].robot < a ||
                       (f.near.pairs[i].robot == a && f.near.pairs[i].other < b)))
                    i++;
                if (a != b && apart_m < 0.1 + RADIUS_M)
                    CHECK(i < f.near.count && f.near.pairs[i].robot == a &&
                          f.near.pairs[i].other == b);
            }
        }
    }
    tear_down(&f);
}

/* Of a crowd, some of them wide and some far outside, exactly those pairs are found, in their
 * order, that are as near as REACH_M + SKIN_M of vs_near.c. */
static void test_a_crowd_has_the_pairs_of_all_with_all(uint32_t seed)
{
    uint32_t random = seed * 2654435761u + 1u, robots = 50 + draw(&random, 100);
    uint32_t bodies = robots + draw(&random, 20), a, b, found = 0;
    double width_m = draw_between(&random, 0.1, 4.0);
    struct floor f;

    build(&f, robots, bodies, 0);
    for (b = 0; b < bodies; b++) {
        f.radii_m[b] = b < robots ? RADIUS_M : draw_between(&random, 0.01, 0.5);
        f.physics.poses[3 * b] = draw_between(&random, -width_m, width_m);
        f.physics.poses[3 * b + 1] = draw_between(&random, -width_m, width_m);
    }
    f.physics.poses[0] = 1e300;
    f.physics.poses[4] = NAN;
    vs_near_update(&f.near, f.physics.poses, 3);
    for (a = 0; a < robots; a++)
        for (b = 0; b < bodies; b++) {
            double x = f.physics.poses[3 * a] - f.physics.poses[3 * b];
            double y = f.physics.poses[3 * a + 1] - f.physics.poses[3 * b + 1];
            double reach_m = 0.11 + 0.02 + f.radii_m[b];

            if (a == b || !(x * x + y * y < reach_m * reach_m))
                continue;
            CHECK(found < f.near.count && f.near.pairs[found].robot == a &&
                  f.near.pairs[found].other == b);
            found++;
        }
    CHECK(found == f.near.count);
    tear_down(&f);
}

/* The distance to a box is that to the nearest point of its outline, and its way out leads
 * there. */
static void test_gaps_lead_to_outlines(uint32_t seed)
{
    uint32_t random = seed * 2654435761u + 1u;
    double row[VS_BOX_NUMBERS], normal[2], way[2], nearest = HUGE_VAL;
    double x = draw_between(&random, -0.5, 0.5), y = draw_between(&random, -0.5, 0.5), gap;
    int i, side;

    row[0] = draw_between(&random, -0.5, 0.5);
    row[1] = draw_between(&random, -0.5, 0.5);
    vs_sin_cos(draw_between(&random, -3.14, 3.14), &row[3], &row[2]);
    row[4] = draw_between(&random, 0.005, 0.3);
    row[5] = draw_between(&random, 0.005, 0.3);
    for (i = -150; i <= 150; i++) {
        for (side = 0; side < 4; side++) {
            double sense = side & 1 ? 1.0 : -1.0;
            double along = row[4] * (side & 2 ? i / 150.0 : sense);
            double aside = row[5] * (side & 2 ? sense : i / 150.0);

            nearest = fmin(nearest, hypot(row[0] + along * row[2] - aside * row[3] - x,
                                          row[1] + along * row[3] + aside * row[2] - y));
        }
    }
    gap = vs_box_gap(row, x, y, normal);
    CHECK(fabs(fabs(gap) - nearest) < 2e-3);
    CHECK(fabs(hypot(normal[0], normal[1]) - 1.0) < 1e-12);
    CHECK(fabs(vs_box_gap(row, x - gap * normal[0], y - gap * normal[1], way)) < 1e-9);
}

static void test_a_point_in_a_box_is_at_a_negative_distance(void)
{
    static const double row[VS_BOX_NUMBERS] = {0.0, 0.0, 1.0, 0.0, 0.1, 0.2};
    double normal[2];

    CHECK(fabs(vs_box_gap(row, 0.07, 0.0, normal) + 0.03) < 1e-12);
    CHECK(normal[0] == 1.0 && normal[1] == 0.0);
}

static void test_roots_are_exact(void)
{
    double value;

    for (value = 1e-12; value < 1e12; value *= 1.7) {
        double root = vs_root(value), off = root * root / value - 1.0;

        CHECK(off < 1e-14 && off > -1e-14);
    }
    CHECK(vs_root(0.0) == 0.0 && vs_root(-1.0) == 0.0);
}

static void test_trigonometry(void)
{
    uint32_t random = 3;
    double sine;
    double cosine;
    int i;

    for (i = 0; i < 100000; i++) {
        double angle = draw_between(&random, -1.0, 1.0) * (i % 2 ? 4.0 : VS_ANGLE_MAX_RAD);
        double wrapped = vs_wrap_angle(angle);

        vs_sin_cos(angle, &sine, &cosine);
        CHECK(fabs(sine - sin(angle)) < 2e-15 && fabs(cosine - cos(angle)) < 2e-15);
        CHECK(wrapped > -3.14159265358979324 && wrapped <= 3.14159265358979324);
        CHECK(fabs(sin(wrapped) - sin(angle)) < 1e-10);
    }
    vs_sin_cos(INFINITY, &sine, &cosine);
    CHECK(sine == 0.0 && cosine == 1.0);
    vs_sin_cos(NAN, &sine, &cosine);
    CHECK(sine == 0.0 && cosine == 1.0);
    CHECK(vs_wrap_angle(3.14159265358979324) > 3.0 && vs_wrap_angle(-3.14159265358979324) > 3.0);
}

int main(int argc, char *argv[])
{
    uint32_t seed, seeds = argc > 1 ? (uint32_t)strtoul(argv[1], NULL, 10) : 300;

    test_roots_are_exact();
    test_trigonometry();
    test_a_point_in_a_box_is_at_a_negative_distance();
    test_a_pile_comes_apart();
    for (seed = 0; seed < seeds; seed++) {
        test_gaps_lead_to_outlines(seed);
        test_a_crowd_has_the_pairs_of_all_with_all(seed);
        test_pairs_hold_until_somebody_has_moved_far(seed);
        test_any_crowd(seed);
        test_a_wedged_robot_is_not_thrown_away(seed);
    }
    return 0;
}
