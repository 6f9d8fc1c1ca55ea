/* SPDX-License-Identifier: MIT */
/*
 * vs_contacts.h - moves overlapping bodies apart by the least possible displacement.
 *
 * Of all displacements that leave no overlap, the one with the smallest sum of squares,
 * each weighted by 1 / mobility, is taken: contacts push and never pull, a chain of robots
 * carries a push on, and who is hard to move gives way less. There is no friction. This is
 * a linear complementarity problem in the pushes of the contacts; it starts from the pushes
 * of the call before, because bodies that lean on each other keep doing so.
 */
#ifndef VS_CONTACTS_H
#define VS_CONTACTS_H

#include "vs_near.h"

/* A robot that touches a body or a box, or nearly. */
struct vs_contact {
    struct vs_pair pair;
    double gap_m;     /* before any push, negative where they overlap */
    double normal[2]; /* unit vector towards the robot */
    double push_m;    /* found: how much this contact pushes, >= 0 */
    double ahead_m;   /* scratch: the guess that goes on from there */
    double change_m;  /* scratch: of push_m in the newest iteration */
    uint32_t next[2]; /* scratch: the next contact of the robot, and of the other */
};

/* All arrays are the caller's; each of contacts and before has as much room as near's pairs. */
struct vs_contacts {
    struct vs_near *near;
    const double *mobility;    /* [bodies] how readily each gives way, 0: not at all */
    struct vs_contact *now;    /* [count] */
    struct vs_contact *before; /* [kept] of the call before; the two change places */
    double *moved_m;           /* [bodies * 2] scratch */
    uint32_t *newest;          /* [bodies] scratch */
    uint32_t count;
    uint32_t kept;
};

/* Moves the bodies apart, in place; positions_m and stride as in vs_near_update. */
void vs_contacts_separate(struct vs_contacts *contacts, double *positions_m, uint32_t stride);

#endif
