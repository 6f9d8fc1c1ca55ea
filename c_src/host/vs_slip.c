/* SPDX-License-Identifier: MIT */
#include "vs_slip.h"

#include "vs_math.h"

#define EVEN 6755399441055744.0 /* adding it rounds to the nearest whole number, halves to even */

void vs_slip_apply(const struct vs_slip *slip, int16_t *wheels)
{
    const struct vs_random *random = slip->random;
    uint32_t count = 2 * slip->robots, i;

    for (i = 0; i < count; i++)
        slip->drawn[i] =
            wheels[i] * (1.0 + slip->relative[i] * random->standard_normal(random->bits));
    for (i = 0; i < count; i++) {
        double factor =
            slip->factor[i] + slip->factor_dev[i] * random->standard_normal(random->bits);
        int is_turning = wheels[i] != 0 || wheels[i ^ 1u] != 0;

        if (is_turning)
            slip->drawn[i] = factor * (slip->drawn[i] + slip->bias[i]);
    }
    for (i = 0; i < count; i++) {
        double speed = (slip->drawn[i] + EVEN) - EVEN;

        wheels[i] = (int16_t)vs_least(vs_most(speed, -slip->most_steps_s), slip->most_steps_s);
    }
}
