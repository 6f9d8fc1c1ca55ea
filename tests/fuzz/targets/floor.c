/* SPDX-License-Identifier: MIT */
/*
 * The host's rays and physics, with obstacles, robots and times of any numbers. Rays refuse what is
 * no number; what they say of the rest is 0 or 1, or a share of the line. Robots whose poses are
 * numbers stay so, whatever they are told and wherever they begin.
 */
#include "../../../c_src/host/vs_physics.h"
#include "../../../c_src/host/vs_rays.h"
#include "../../../c_src/host/vs_ring.h"
#include "fuzz.h"

#include <math.h>

#define BODIES 6
#define BOXES 3
#define LINES 8
#define MEMORY (1u << 16)

static double number(struct input *in)
{
    uint8_t how = take_u8(in);

    if (how >= 250)
        return take_double(in);
    return (int16_t)take_u16(in) / (how & 1 ? 8192.0 : 1024.0);
}

static void try_rays(struct input *in)
{
    static uint32_t memory[MEMORY];
    struct vs_obstacle bodies[BODIES];
    struct vs_obstacles o;
    double starts[3 * LINES];
    double ends[3 * LINES];
    double shares[LINES];
    int32_t skip[LINES];
    uint8_t blocked[LINES];
    uint8_t seen[LINES * LINES];
    uint32_t i;

    memset(&o, 0, sizeof o);
    o.bodies = bodies;
    o.count = take_below(in, BODIES + 1);
    for (i = 0; i < BODIES; i++) {
        struct vs_obstacle one = {number(in), number(in), number(in), number(in), number(in),
                                  number(in), number(in), 1.0, 0.0};

        bodies[i] = one;
        bodies[i].cosine = cos(0.1 * i);
        bodies[i].sine = sin(0.1 * i);
    }
    for (i = 0; i < 3 * LINES; i++) {
        starts[i] = number(in);
        ends[i] = number(in);
    }
    for (i = 0; i < LINES; i++)
        skip[i] = (int32_t)take_below(in, BODIES + 1) - 1;
    if (vs_obstacles_plan(&o) != VS_OK)
        return;
    CHECK(o.words <= MEMORY);
    vs_obstacles_sort(&o, memory);
    if (vs_rays_blocked(&o, starts, ends, LINES, skip, 1, blocked) != VS_OK) {
        CHECK(vs_rays_nearest(&o, starts, ends, LINES, skip, 1, shares) != VS_OK);
        return;
    }
    CHECK(vs_rays_nearest(&o, starts, ends, LINES, skip, 1, shares) == VS_OK);
    CHECK(vs_sight_seen(&o, starts, LINES, ends, LINES, skip, 1, seen) == VS_OK);
    for (i = 0; i < LINES; i++) {
        CHECK(blocked[i] <= 1);
        CHECK((shares[i] >= 0.0 && shares[i] <= 1.0) || shares[i] == INFINITY);
        CHECK(blocked[i] == (shares[i] <= 1.0));
        CHECK(seen[i * LINES + i] == !blocked[i]);
    }
}

static struct {
    double radii_m[BODIES];
    double box_rows[BOXES * VS_BOX_NUMBERS];
    double searched_m[2 * BODIES];
    struct vs_pair pairs[BODIES * (BODIES + BOXES)];
    double mobility[BODIES];
    struct vs_contact now[BODIES * (BODIES + BOXES)];
    struct vs_contact before[BODIES * (BODIES + BOXES)];
    double moved_m[2 * BODIES];
    uint32_t newest[BODIES];
    double poses[3 * BODIES];
    double wheels_m_s[2 * BODIES];
    int16_t commands[2 * BODIES];
    int64_t rolled_ns[BODIES];
    double arcs[2 * BODIES];
    struct vs_drive drives[BODIES];
} m;

/* Finite numbers: who places robots has checked them. */
static double place(struct input *in)
{
    return (int16_t)take_u16(in) / 16384.0;
}

static void make_scene(struct input *in, struct vs_near *near)
{
    static const struct vs_drive drives[2] = {{1.288e-4, 0.053, 0.0, 1.0, 10000, 1000},
                                              {1e-3, 0.09, 1.0, 0.1, 0, 300}};
    uint32_t i;

    memset(&m, 0, sizeof m);
    for (i = 0; i < BODIES; i++) {
        m.radii_m[i] = take_u8(in) / 2000.0 + 0.001;
        m.poses[3 * i] = place(in);
        m.poses[3 * i + 1] = place(in);
        m.poses[3 * i + 2] = place(in);
        m.mobility[i] = i < near->robots ? 1.0 : 0.0;
        m.drives[i] = drives[take_u8(in) % 2];
    }
    for (i = 0; i < BOXES; i++) {
        double angle = place(in);
        double row[VS_BOX_NUMBERS] = {place(in), place(in), cos(angle), sin(angle),
                                      take_u8(in) / 512.0, take_u8(in) / 512.0};

        memcpy(m.box_rows + i * VS_BOX_NUMBERS, row, sizeof row);
    }
}

static void check_ring(const struct vs_near *near)
{
    static const double from[4] = {0.03, 0.0, -0.03, 0.0};
    static const double ray_x[4] = {1.0, 0.8, -1.0, 0.0};
    static const double ray_y[4] = {0.0, 0.6, 0.0, 1.0};
    static const double response[2] = {1.0, 0.5};
    static const double table_m[3] = {0.0, 0.02, 0.05};
    static const double table_raw[3] = {3800.0, 700.0, 60.0};
    const struct vs_ring ring = {2, 2, from, from, ray_x, ray_y, response, 3, table_m, table_raw, NULL};
    const struct vs_ring *each[BODIES];
    double distances_m[2 * VS_RING_SENSORS * BODIES];
    const struct vs_rings rings = {each, near, NULL, NULL, distances_m, NULL, NULL};
    double raw[2 * BODIES];
    uint32_t i;

    for (i = 0; i < near->robots; i++)
        each[i] = &ring;
    vs_rings_distances(&rings, m.poses);
    vs_ring_readings(&ring, distances_m, 2 * near->robots, raw);
    for (i = 0; i < 4 * near->robots; i++)
        CHECK(distances_m[i] >= 0.0);
    for (i = 0; i < 2 * near->robots; i++)
        CHECK(raw[i] >= 60.0 && raw[i] <= 3800.0);
}

static void try_physics(struct input *in)
{
    struct vs_near near = {1 + take_below(in, BODIES), BODIES, take_below(in, BOXES + 1),
                           0.11, m.radii_m, m.box_rows, m.searched_m, m.pairs, NULL, NULL, 0, 0};
    struct vs_contacts contacts = {&near, m.mobility, m.now, m.before, m.moved_m, m.newest, 0, 0};
    struct vs_physics physics = {&contacts, m.poses, m.mobility, m.wheels_m_s, m.commands,
                                 m.rolled_ns, m.arcs, m.drives, NULL, 0};
    int64_t now_ns = 0;
    uint32_t i;

    make_scene(in, &near);
    vs_physics_init(&physics, 0);
    while (in->left > 0 && now_ns < INT64_C(3000000000)) {
        uint32_t robot = take_below(in, near.robots);

        vs_physics_drive(&physics, robot, (int16_t)take_u16(in), (int16_t)take_u16(in),
                         now_ns + (int16_t)take_u16(in) * 1000);
        now_ns += take_u16(in) * INT64_C(2000);
        vs_physics_advance(&physics, now_ns);
        for (i = 0; i < 3 * BODIES; i++)
            CHECK(isfinite(m.poses[i]) && fabs(m.poses[i]) < 100.0);
        CHECK(near.count <= BODIES * (BODIES + BOXES) && contacts.count <= near.count);
        if (robot == 0)
            check_ring(&near);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct input in = {data, size};

    if (take_u8(&in) & 1)
        try_rays(&in);
    else
        try_physics(&in);
    return 0;
}
