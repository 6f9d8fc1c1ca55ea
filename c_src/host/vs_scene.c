/* SPDX-License-Identifier: MIT */
#include "vs_scene.h"

#include <string.h>

#include "../vs_err.h"
#include "vs_math.h"
#include "vs_place.h"

#define MOST_SINGLE 3.4028234663852886e38

/* The least and the largest number of each type, and its bytes. */
static const struct kind {
    double low;
    double high;
    size_t bytes;
} kinds[] = {
    {-MOST_SINGLE, MOST_SINGLE, 4}, {0.0, 255.0, 1},           {-32768.0, 32767.0, 2},
    {0.0, 65535.0, 2},              {-2147483648.0, 2147483647.0, 4}, {0.0, 4294967295.0, 4},
};

/* What becomes of number k of a robot's reading. */
static double distorted(const struct vs_sent *sent, double value, double offset, uint32_t k)
{
    const struct kind *kind = &kinds[sent->type];
    double noisy = value + offset * sent->unit[k];

    noisy = vs_least(vs_most(noisy, sent->low[k]), sent->high[k]);
    return vs_least(vs_most(noisy, kind->low), kind->high);
}

/* The nearest whole number; of two, the even one. Up to 2^32. */
static int64_t nearest(double value)
{
    int64_t whole = (int64_t)value;
    double rest;

    if ((double)whole > value)
        whole--;
    rest = value - (double)whole;
    return whole + (rest > 0.5 || (rest == 0.5 && whole % 2 != 0));
}

/* Writes a number, little-endian as the machines that this runs on. */
static void put(uint8_t *to, uint32_t type, double value)
{
    if (type == VS_NUMBER_F4) {
        float single = (float)value;

        memcpy(to, &single, sizeof single);
    } else {
        int64_t whole = nearest(value);

        memcpy(to, &whole, kinds[type].bytes);
    }
}

static double get(const uint8_t *from, uint32_t type)
{
    float single;
    uint64_t bits = 0;

    if (type == VS_NUMBER_F4) {
        memcpy(&single, from, sizeof single);
        return single;
    }
    memcpy(&bits, from, kinds[type].bytes);
    if (type == VS_NUMBER_I2)
        return (int16_t)bits;
    return type == VS_NUMBER_I4 ? (int32_t)bits : (double)bits;
}

int vs_sent_renew(const struct vs_sent *sent, int64_t capture_ns)
{
    const struct kind *kind = &kinds[sent->type];
    uint32_t i, k;

    for (i = 0; i < sent->robots; i++) {
        const double *fresh = sent->fresh + (size_t)i * sent->count;
        uint8_t *to = sent->block + i * sent->stride;

        for (k = 0; k < sent->count; k++)
            if (!vs_is_within(fresh[k], kind->low, kind->high))
                return VS_ERR_ARGUMENT;
        for (k = 0; k < sent->count; k++) {
            double value = fresh[k];

            if (sent->offsets)
                value = distorted(sent, value, sent->offsets[(size_t)i * sent->count + k], k);
            put(to + k * kind->bytes, sent->type, value);
        }
        sent->captures_ns[i * sent->step] = capture_ns;
    }
    return VS_OK;
}

void vs_heard_renew(const struct vs_heard *heard)
{
    uint32_t i, k;

    for (i = 0; i < heard->robots; i++)
        for (k = 0; k < heard->count; k++) {
            size_t at = (size_t)i * heard->count + k;
            double said = get(heard->block + i * heard->stride + k * kinds[heard->type].bytes,
                              heard->type);

            said = said == said ? said : 0.0;
            said = vs_least(vs_most(said, heard->low[k]), heard->high[k]);
            heard->levels[at] = said;
            heard->growth[at] = said >= heard->last[at] ? said - heard->last[at] : said;
            heard->growth[at] = vs_most(heard->growth[at], 0.0);
            heard->last[at] = said;
        }
}
