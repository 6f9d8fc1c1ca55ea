/* SPDX-License-Identifier: MIT */
#include "vs_ring.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "vs_math.h"

#define EVEN 6755399441055744.0 /* adding it rounds to the nearest whole number, halves to even */
#define PARALLEL 1e-30 /* stands for a slope of exactly 0: no 0 / 0 on a box's edge */

/* Shortens the rays of a robot that meet a disc. */
static void meet_disc(const struct vs_ring *ring, const double *pose, const double *disc_m,
                      double radius_m, double *distances_m)
{
    double east = disc_m[0] - pose[0];
    double north = disc_m[1] - pose[1];
    double sine;
    double cosine;
    uint32_t i;

    vs_sin_cos(pose[2], &sine, &cosine);
    for (i = 0; i < ring->sensors * ring->rays; i++) {
        double ahead = east * cosine + north * sine - ring->from_x_m[i];
        double aside = north * cosine - east * sine - ring->from_y_m[i];
        double along = ahead * ring->ray_x[i] + aside * ring->ray_y[i];
        double across = aside * ring->ray_x[i] - ahead * ring->ray_y[i];
        double half_chord_squared = radius_m * radius_m - across * across;
        double half_chord_m;

        if (half_chord_squared <= 0.0 || along <= -radius_m)
            continue;
        half_chord_m = vs_root(half_chord_squared);
        if (along + half_chord_m <= 0.0)
            continue;
        along = along > half_chord_m ? along - half_chord_m : 0.0;
        distances_m[i] = along < distances_m[i] ? along : distances_m[i];
    }
}

/* A robot as a box sees it. */
struct facing {
    double x_m;
    double y_m;
    double cosine;
    double sine;
};

static struct facing face(const double *pose, const double *box_row)
{
    double east = pose[0] - box_row[0];
    double north = pose[1] - box_row[1];
    struct facing f;
    double sine;
    double cosine;

    vs_sin_cos(pose[2], &sine, &cosine);
    f.x_m = east * box_row[2] + north * box_row[3];
    f.y_m = north * box_row[2] - east * box_row[3];
    f.cosine = cosine * box_row[2] + sine * box_row[3];
    f.sine = sine * box_row[2] - cosine * box_row[3];
    return f;
}

/* Narrows [*enter, *leave] to where a ray is in the strip |coordinate| <= half_m. */
static void pass_strip(double start_m, double slope, double half_m, double *enter,
                       double *leave)
{
    double pace = 1.0 / (slope == 0.0 ? PARALLEL : slope);
    double middle = -start_m * pace;
    double reach = half_m * (pace < 0.0 ? -pace : pace);

    if (middle - reach > *enter)
        *enter = middle - reach;
    if (middle + reach < *leave)
        *leave = middle + reach;
}

/* Shortens the rays of a robot that meet a box. */
static void meet_box(const struct vs_ring *ring, const double *pose, const double *box_row,
                     double *distances_m)
{
    struct facing f = face(pose, box_row);
    uint32_t i;

    for (i = 0; i < ring->sensors * ring->rays; i++) {
        double x_m = f.x_m + ring->from_x_m[i] * f.cosine - ring->from_y_m[i] * f.sine;
        double y_m = f.y_m + ring->from_x_m[i] * f.sine + ring->from_y_m[i] * f.cosine;
        double enter = 0.0;
        double leave = distances_m[i];

        pass_strip(x_m, ring->ray_x[i] * f.cosine - ring->ray_y[i] * f.sine, box_row[4],
                   &enter, &leave);
        pass_strip(y_m, ring->ray_x[i] * f.sine + ring->ray_y[i] * f.cosine, box_row[5],
                   &enter, &leave);
        if (enter <= leave && leave > 0.0)
            distances_m[i] = enter;
    }
}

void vs_rings_distances(const struct vs_rings *rings, const double *poses)
{
    const struct vs_near *near = rings->near;
    uint32_t rays = near->robots > 0 ? VS_RING_SENSORS * rings->rings[0]->rays : 0;
    uint32_t i;

    for (i = 0; i < near->robots * rays; i++)
        rings->distances_m[i] = HUGE_VAL;
    for (i = 0; i < near->count; i++) {
        const struct vs_pair *pair = &near->pairs[i];
        const struct vs_ring *ring = rings->rings[pair->robot];
        const double *pose = poses + 3 * pair->robot;
        double *of_robot_m = rings->distances_m + pair->robot * rays;

        if (pair->other < near->bodies)
            meet_disc(ring, pose, poses + 3 * pair->other, near->radii_m[pair->other],
                      of_robot_m);
        else
            meet_box(ring, pose, near->box_rows + VS_BOX_NUMBERS * (pair->other - near->bodies),
                     of_robot_m);
    }
}

/* Straight lines between the table's points. */
static double look_up(const struct vs_ring *ring, double distance_m)
{
    uint32_t last = ring->points - 1;
    uint32_t i = 1;
    double share;

    if (!(distance_m < ring->table_m[last]))
        return ring->table_raw[last];
    while (distance_m >= ring->table_m[i])
        i++;
    share = (distance_m - ring->table_m[i - 1]) / (ring->table_m[i] - ring->table_m[i - 1]);
    return ring->table_raw[i - 1] + share * (ring->table_raw[i] - ring->table_raw[i - 1]);
}

void vs_ring_readings(const struct vs_ring *ring, const double *distances_m, uint32_t n,
                      double *raw)
{
    double nothing = ring->table_raw[ring->points - 1];
    uint32_t s;
    uint32_t r;

    for (s = 0; s < n; s++) {
        double strongest = 0.0;

        for (r = 0; r < ring->rays; r++) {
            double excess = look_up(ring, distances_m[s * ring->rays + r]) - nothing;

            if (excess * ring->response[r] > strongest)
                strongest = excess * ring->response[r];
        }
        raw[s] = nothing + strongest;
    }
}

/* What one robot's sensors read, with their noise. */
static void read_ring(const struct vs_rings *rings, uint32_t robot, const double *noise)
{
    const struct vs_ring *ring = rings->rings[robot];
    uint32_t first = robot * VS_RING_SENSORS;
    double nothing = ring->table_raw[ring->points - 1];
    uint32_t i;

    vs_ring_readings(ring, rings->distances_m + first * ring->rays, ring->sensors,
                     rings->clean + first);
    for (i = first; i < first + ring->sensors; i++) {
        double value = rings->clean[i];

        if (rings->gain != NULL)
            value = nothing + (value - nothing) * rings->gain[i] + rings->bias[i];
        value += noise[i];
        value = vs_least(vs_most(value, 0.0), VS_RING_RAW_MAX);
        rings->raw[i] = (int16_t)((value + EVEN) - EVEN);
    }
}

/* Each of an e-puck's sensors reads what the nearest of those reads that stand in for it. */
static void stand_in(const struct vs_ring *ring, int16_t *raw)
{
    int16_t own[VS_RING_SENSORS];
    uint32_t i;
    uint32_t s;

    memcpy(own, raw, sizeof own);
    for (i = 0; i < VS_RING_SENSORS; i++) {
        raw[i] = 0;
        for (s = 0; s < ring->sensors; s++)
            if ((ring->stand_in[i] >> s & 1u) != 0 && own[s] > raw[i])
                raw[i] = own[s];
    }
}

void vs_rings_read(const struct vs_rings *rings, const double *poses, const double *noise)
{
    uint32_t robot;

    vs_rings_distances(rings, poses);
    for (robot = 0; robot < rings->near->robots; robot++)
        read_ring(rings, robot, noise);
    for (robot = 0; robot < rings->near->robots; robot++)
        if (rings->rings[robot]->stand_in != NULL)
            stand_in(rings->rings[robot], rings->raw + robot * VS_RING_SENSORS);
}
