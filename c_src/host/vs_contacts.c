/* SPDX-License-Identifier: MIT */
#include "vs_contacts.h"

#include "vs_math.h"

#define MARGIN_M 0.004    /* gaps up to here take part: more than two e-pucks close in a tick */
#define SLACK_M 1e-9      /* more than rounding changes a gap by */
#define TOLERANCE_M 1e-5  /* overlap, or needless gap, that a solution may leave */
#define MAX_ITERATIONS 100
#define NONE UINT32_MAX

/* Whether a pair is so far apart that it cannot take part, without a root: most are. */
static int is_far(const struct vs_near *near, const struct vs_pair *pair,
                  const double *positions_m, uint32_t stride)
{
    const double *one = positions_m + pair->robot * stride;
    double radius_m = near->radii_m[pair->robot];
    const double *other, *row;
    double x, y, reach_m;

    if (pair->other < near->bodies) {
        other = positions_m + pair->other * stride;
        x = one[0] - other[0];
        y = one[1] - other[1];
        reach_m = radius_m + near->radii_m[pair->other] + MARGIN_M + SLACK_M;
        return x * x + y * y > reach_m * reach_m;
    }
    row = near->box_rows + VS_BOX_NUMBERS * (pair->other - near->bodies);
    x = (one[0] - row[0]) * row[2] + (one[1] - row[1]) * row[3];
    y = (one[1] - row[1]) * row[2] - (one[0] - row[0]) * row[3];
    reach_m = radius_m + MARGIN_M + SLACK_M;
    return vs_most((x < 0.0 ? -x : x) - row[4], (y < 0.0 ? -y : y) - row[5]) > reach_m;
}

/* Gap and normal of a robot and another body. */
static double disc_gap(const struct vs_near *near, const struct vs_pair *pair,
                       const double *positions_m, uint32_t stride, double normal[2])
{
    const double *one = positions_m + pair->robot * stride;
    const double *other = positions_m + pair->other * stride;
    double x = one[0] - other[0];
    double y = one[1] - other[1];
    double apart = vs_root(x * x + y * y);

    /* On the same spot any direction will do. */
    normal[0] = apart > 0.0 ? x / apart : 1.0;
    normal[1] = apart > 0.0 ? y / apart : 0.0;
    return apart - near->radii_m[pair->robot] - near->radii_m[pair->other];
}

/* Collects what may touch in this tick; returns 1 if anybody overlaps. */
static int find_contacts(struct vs_contacts *c, const double *positions_m, uint32_t stride)
{
    const struct vs_near *near = c->near;
    int overlap = 0;
    uint32_t i;

    c->count = 0;
    for (i = 0; i < near->count; i++) {
        const struct vs_pair *pair = &near->pairs[i];
        struct vs_contact *contact = &c->now[c->count];
        const double *at = positions_m + pair->robot * stride;
        uint32_t box = pair->other - near->bodies;

        if (pair->other < near->robots && pair->other < pair->robot)
            continue; /* two robots are near each other twice */
        if (is_far(near, pair, positions_m, stride))
            continue;
        if (pair->other < near->bodies)
            contact->gap_m = disc_gap(near, pair, positions_m, stride, contact->normal);
        else
            contact->gap_m = vs_box_gap(near->box_rows + VS_BOX_NUMBERS * box, at[0], at[1],
                                        contact->normal) - near->radii_m[pair->robot];
        if (contact->gap_m >= MARGIN_M)
            continue;
        contact->pair = *pair;
        overlap |= contact->gap_m < 0.0;
        c->count++;
    }
    return overlap;
}

static int comes_before(const struct vs_pair *a, const struct vs_pair *b)
{
    return a->robot != b->robot ? a->robot < b->robot : a->other < b->other;
}

/* Begins with the pushes of the call before; both lists are in the pairs' order. */
static void guess(struct vs_contacts *c)
{
    uint32_t old = 0;
    uint32_t i;

    for (i = 0; i < c->count; i++) {
        struct vs_contact *contact = &c->now[i];

        while (old < c->kept && comes_before(&c->before[old].pair, &contact->pair))
            old++;
        contact->push_m = 0.0;
        if (old < c->kept && !comes_before(&contact->pair, &c->before[old].pair))
            contact->push_m = c->before[old].push_m;
        contact->ahead_m = contact->push_m;
    }
}

/* Links the contacts of every body into a list. */
static void link_contacts(struct vs_contacts *c)
{
    uint32_t i;

    for (i = 0; i < c->near->bodies; i++)
        c->newest[i] = NONE;
    for (i = 0; i < c->count; i++) {
        struct vs_contact *contact = &c->now[i];

        contact->next[0] = c->newest[contact->pair.robot];
        c->newest[contact->pair.robot] = i;
        if (contact->pair.other >= c->near->bodies)
            continue;
        contact->next[1] = c->newest[contact->pair.other];
        c->newest[contact->pair.other] = i;
    }
}

/* How much all pushes of size 1 on one body could close a contact with this normal. */
static double coupling(const struct vs_contacts *c, uint32_t body, const double normal[2])
{
    double sum = 0.0;
    uint32_t i = c->newest[body];

    while (i != NONE) {
        const struct vs_contact *contact = &c->now[i];
        double share = contact->normal[0] * normal[0] + contact->normal[1] * normal[1];

        sum += share < 0.0 ? -share : share;
        i = contact->next[contact->pair.robot == body ? 0 : 1];
    }
    return c->mobility[body] * sum;
}

/* The longest safe step: one over the largest sum of a row of the coupling's sizes. */
static double step_size(struct vs_contacts *c)
{
    double largest = 0.0;
    uint32_t i;

    link_contacts(c);
    for (i = 0; i < c->count; i++) {
        const struct vs_contact *contact = &c->now[i];
        double sum = coupling(c, contact->pair.robot, contact->normal);

        if (contact->pair.other < c->near->bodies)
            sum += coupling(c, contact->pair.other, contact->normal);
        if (sum > largest)
            largest = sum;
    }
    return largest > 0.0 ? 1.0 / largest : 0.0;
}

/* Sets moved_m to where the pushes (ahead: the guesses that go on from them) move everybody. */
static void displace(struct vs_contacts *c, int ahead)
{
    uint32_t bodies = c->near->bodies;
    uint32_t i;

    for (i = 0; i < 2 * bodies; i++)
        c->moved_m[i] = 0.0;
    for (i = 0; i < c->count; i++) {
        const struct vs_contact *contact = &c->now[i];
        double size_m = ahead ? contact->ahead_m : contact->push_m;
        uint32_t one = contact->pair.robot;
        uint32_t other = contact->pair.other;

        c->moved_m[2 * one] += c->mobility[one] * size_m * contact->normal[0];
        c->moved_m[2 * one + 1] += c->mobility[one] * size_m * contact->normal[1];
        if (other >= bodies)
            continue;
        c->moved_m[2 * other] -= c->mobility[other] * size_m * contact->normal[0];
        c->moved_m[2 * other + 1] -= c->mobility[other] * size_m * contact->normal[1];
    }
}

/* Gap of a contact once moved_m has been applied. */
static double gap_then_m(const struct vs_contacts *c, const struct vs_contact *contact)
{
    const double *one = c->moved_m + 2 * contact->pair.robot;
    double gap_m = contact->gap_m + one[0] * contact->normal[0] + one[1] * contact->normal[1];

    if (contact->pair.other < c->near->bodies) {
        const double *other = c->moved_m + 2 * contact->pair.other;

        gap_m -= other[0] * contact->normal[0] + other[1] * contact->normal[1];
    }
    return gap_m;
}

/* One step of projected gradient from the guesses. Returns the largest correction;
 * *turned tells whether all of them go against the way that led there. */
static double improve(struct vs_contacts *c, double step, int *turned)
{
    double largest = 0.0;
    double along = 0.0;
    uint32_t i;

    displace(c, 1);
    for (i = 0; i < c->count; i++) {
        struct vs_contact *contact = &c->now[i];
        double better_m = contact->ahead_m - step * gap_then_m(c, contact);
        double correction_m;

        better_m = better_m > 0.0 ? better_m : 0.0;
        correction_m = better_m - contact->ahead_m;
        contact->change_m = better_m - contact->push_m;
        contact->push_m = better_m;
        along += correction_m * contact->change_m;
        correction_m = correction_m < 0.0 ? -correction_m : correction_m;
        largest = correction_m > largest ? correction_m : largest;
    }
    *turned = along < 0.0;
    return largest;
}

/* The next guesses: on from the pushes by a share of their last change. */
static void go_on(struct vs_contacts *c, double share)
{
    uint32_t i;

    for (i = 0; i < c->count; i++)
        c->now[i].ahead_m = c->now[i].push_m + share * c->now[i].change_m;
}

/*
 * The smallest pushes >= 0 that leave no overlap. Accelerated projected gradient with
 * restarts. Source: Y. Nesterov, "A method for solving the convex programming problem with
 * convergence rate O(1/k^2)", 1983; restarts: B. O'Donoghue and E. Candes, "Adaptive
 * restart for accelerated gradient schemes", 2015.
 */
static void solve(struct vs_contacts *c)
{
    double step = step_size(c);
    double momentum = 1.0;
    int i;

    for (i = 0; i < MAX_ITERATIONS; i++) {
        double faster;
        int turned;

        if (improve(c, step, &turned) < TOLERANCE_M * step)
            return;
        momentum = turned ? 1.0 : momentum;
        faster = 0.5 + vs_root(0.25 + momentum * momentum);
        go_on(c, (momentum - 1.0) / faster);
        momentum = faster;
    }
}

/* Who is wedged between things that never move overlaps one of them whatever is done, and pushes
 * grow without end: nobody is moved farther than twice what all overlaps come to together. */
static void limit(struct vs_contacts *c)
{
    double most_m = 0.0;
    uint32_t i;

    for (i = 0; i < c->count; i++)
        most_m -= c->now[i].gap_m < 0.0 ? 2.0 * c->now[i].gap_m : 0.0;
    for (i = 0; i < c->near->bodies; i++) {
        double *way = c->moved_m + 2 * i;
        double way_m = vs_root(way[0] * way[0] + way[1] * way[1]);

        if (way_m <= most_m)
            continue;
        way[0] *= most_m / way_m;
        way[1] *= most_m / way_m;
    }
}

void vs_contacts_separate(struct vs_contacts *contacts, double *positions_m, uint32_t stride)
{
    struct vs_contact *swap = contacts->before;
    uint32_t b;

    vs_near_update(contacts->near, positions_m, stride);
    if (!find_contacts(contacts, positions_m, stride)) {
        contacts->kept = 0;
        return;
    }
    guess(contacts);
    solve(contacts);
    displace(contacts, 0);
    limit(contacts);
    for (b = 0; b < contacts->near->bodies; b++) {
        positions_m[b * stride] += contacts->moved_m[2 * b];
        positions_m[b * stride + 1] += contacts->moved_m[2 * b + 1];
    }
    contacts->before = contacts->now;
    contacts->now = swap;
    contacts->kept = contacts->count;
}
