/* SPDX-License-Identifier: MIT */
/*
 * vs_sight.h - which points see which goals: bundles of lines at once.
 *
 * The sensors of one robot are close together and look at the same few lights: what may
 * stand between all of them and a light is searched for once.
 */
#ifndef VS_SIGHT_H
#define VS_SIGHT_H

#include <stddef.h>
#include <stdint.h>

#include "vs_err.h"
#include "vs_obstacles.h"

/*
 * Of lines from each of count points to each of goals goals, three coordinates each:
 * seen[i * goals + k] is 1 where goal k is seen from point i, else 0. skip holds skips
 * numbers of obstacles for every point, one after the other: these do not count; -1 is
 * nobody. Quick where neighbours in the list are neighbours in the arena.
 * Errors: as vs_rays_aim.
 */
int vs_sight_seen(const struct vs_obstacles *obstacles, const double *points, size_t count,
                  const double *goals_at, size_t goals, const int32_t *skip, size_t skips,
                  uint8_t *seen);

#endif
