/* SPDX-License-Identifier: MIT */
#include "vs_scene.h"

#include <string.h>

#include "../vs_err.h"
#include "vs_math.h"

#define MOST_SINGLE 3.4028234663852886e38

/* What becomes of number k of a robot's reading. */
static double distorted(const struct vs_sent *sent, double value, double offset, uint32_t k)
{
    double noisy = value + offset * sent->unit[k];

    noisy = vs_least(vs_most(noisy, sent->low[k]), sent->high[k]);
    return vs_least(vs_most(noisy, -MOST_SINGLE), MOST_SINGLE);
}

int vs_sent_renew(const struct vs_sent *sent, int64_t capture_ns)
{
    uint32_t i, k;

    for (i = 0; i < sent->robots; i++) {
        const double *fresh = sent->fresh + (size_t)i * sent->count;
        uint8_t *to = sent->block + i * sent->stride;

        for (k = 0; k < sent->count; k++)
            if (!vs_is_within(fresh[k], -MOST_SINGLE, MOST_SINGLE))
                return VS_ERR_ARGUMENT;
        for (k = 0; k < sent->count; k++) {
            double value = fresh[k];
            float single;

            if (sent->offsets)
                value = distorted(sent, value, sent->offsets[(size_t)i * sent->count + k], k);
            single = (float)value;
            memcpy(to + k * sizeof single, &single, sizeof single);
        }
        sent->captures_ns[i * sent->step] = capture_ns;
    }
    return VS_OK;
}
