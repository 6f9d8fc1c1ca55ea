/* SPDX-License-Identifier: MIT */
/*
 * vs_contacts.h - how bodies that overlap on the floor of vs_physics.h are moved apart.
 */
#ifndef VS_CONTACTS_H
#define VS_CONTACTS_H

#include "vs_near.h"

/*
 * Moves overlapping bodies apart, in place; positions_m and stride as in vs_near_update.
 *
 * Of all displacements that leave no overlap, the one with the smallest sum of squares,
 * each weighted by 1 / mobility, is taken: contacts push and never pull, a chain of robots
 * carries a push on, and who is hard to move gives way less. There is no friction. This is
 * a linear complementarity problem in the pushes of the contacts; it starts from the pushes
 * of the call before, because bodies that lean on each other keep doing so.
 */
void vs_contacts_separate(struct vs_contacts *contacts, double *positions_m, uint32_t stride);

#endif
