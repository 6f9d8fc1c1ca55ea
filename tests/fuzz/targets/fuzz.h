/* SPDX-License-Identifier: MIT */
/* fuzz.h - what every target uses: an input that is taken piece by piece, and zeros at its end. */
#ifndef FUZZ_H
#define FUZZ_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "../../c/check.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

struct input {
    const uint8_t *at;
    size_t left;
};

static inline uint8_t take_u8(struct input *in)
{
    if (in->left == 0)
        return 0;
    in->left--;
    return *in->at++;
}

static inline uint16_t take_u16(struct input *in)
{
    uint16_t low = take_u8(in);

    return (uint16_t)(low | take_u8(in) << 8);
}

static inline uint32_t take_u32(struct input *in)
{
    uint32_t low = take_u16(in);

    return low | (uint32_t)take_u16(in) << 16;
}

static inline uint64_t take_u64(struct input *in)
{
    uint64_t low = take_u32(in);

    return low | (uint64_t)take_u32(in) << 32;
}

/* Any number, infinite and none included. */
static inline double take_double(struct input *in)
{
    uint64_t bits = take_u64(in);
    double value;

    memcpy(&value, &bits, sizeof value);
    return value;
}

/* The next bytes of the input; fewer where it ends. */
static inline const uint8_t *take_bytes(struct input *in, size_t *len)
{
    const uint8_t *bytes = in->at;

    if (*len > in->left)
        *len = in->left;
    in->at += *len;
    in->left -= *len;
    return bytes;
}

/* Fills a buffer; zeros where the input ends. */
static inline void take_into(struct input *in, void *to, size_t len)
{
    size_t have = len;
    const uint8_t *bytes = take_bytes(in, &have);

    memset(to, 0, len);
    if (have > 0)
        memcpy(to, bytes, have);
}

/* A number below a limit, of one byte. */
static inline uint32_t take_below(struct input *in, uint32_t limit)
{
    return take_u8(in) % limit;
}

#ifdef WITHOUT_LIBFUZZER
/* Runs the target on the files it is given: any compiler makes it, clang's runtime is not needed. */
int main(int count, char **paths)
{
    static uint8_t data[1 << 16];
    int i;

    for (i = 1; i < count; i++) {
        FILE *file = fopen(paths[i], "rb");
        size_t size;

        CHECK_FOR(paths[i], file != NULL);
        size = fread(data, 1, sizeof data, file);
        CHECK_FOR(paths[i], feof(file) && fclose(file) == 0);
        CHECK_FOR(paths[i], LLVMFuzzerTestOneInput(data, size) == 0);
    }
    return 0;
}
#endif

#endif
