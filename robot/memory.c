/* SPDX-License-Identifier: MIT */
#include "memory.h"

#include <stdint.h>
#include <string.h>

/* Whatever the bytes are of. */
struct word {
    uintptr_t bits;
} __attribute__((may_alias));

struct line {
    uintptr_t words[8];
} __attribute__((may_alias));

struct half {
    uintptr_t words[4];
} __attribute__((may_alias));

/* A compiler that knows memcpy and memset would put calls of them in place of the loops. */
#define KEEP_THE_LOOP() __asm__ volatile("")

/* How many bytes of len come before an address that words may have. */
static size_t before_words(const void *at, size_t len)
{
    size_t few = -(uintptr_t)at % sizeof(struct word);

    return few < len ? few : len;
}

static void copy_bytes(unsigned char *to, const unsigned char *from, size_t len)
{
    while (len-- > 0) {
        *to++ = *from++;
        KEEP_THE_LOOP();
    }
}

static void set_bytes(unsigned char *to, int value, size_t len)
{
    while (len-- > 0) {
        *to++ = (unsigned char)value;
        KEEP_THE_LOOP();
    }
}

void *vs_memory_copy(void *restrict to, const void *restrict from, size_t len)
{
    unsigned char *t = to;
    const unsigned char *f = from;

    if (((uintptr_t)t - (uintptr_t)f) % sizeof(struct word) == 0) {
        size_t few = before_words(t, len);

        copy_bytes(t, f, few);
        t += few;
        f += few;
        len -= few;
        for (; len >= sizeof(struct line); t += sizeof(struct line), f += sizeof(struct line)) {
            *(struct line *)(void *)t = *(const struct line *)(const void *)f;
            len -= sizeof(struct line);
            KEEP_THE_LOOP();
        }
        if (len >= sizeof(struct half)) {
            *(struct half *)(void *)t = *(const struct half *)(const void *)f;
            t += sizeof(struct half);
            f += sizeof(struct half);
            len -= sizeof(struct half);
        }
        for (; len >= sizeof(struct word); t += sizeof(struct word), f += sizeof(struct word)) {
            *(struct word *)(void *)t = *(const struct word *)(const void *)f;
            len -= sizeof(struct word);
            KEEP_THE_LOOP();
        }
    }
    copy_bytes(t, f, len);
    return to;
}

void *vs_memory_set(void *to, int value, size_t len)
{
    uintptr_t bits = (uintptr_t)-1 / 255u * (unsigned char)value;
    struct line line = {{bits, bits, bits, bits, bits, bits, bits, bits}};
    unsigned char *t = to;
    size_t few = before_words(t, len);

    set_bytes(t, value, few);
    t += few;
    len -= few;
    for (; len >= sizeof line; t += sizeof line) {
        *(struct line *)(void *)t = line;
        len -= sizeof line;
        KEEP_THE_LOOP();
    }
    for (; len >= sizeof bits; t += sizeof bits) {
        ((struct word *)(void *)t)->bits = bits;
        len -= sizeof bits;
        KEEP_THE_LOOP();
    }
    set_bytes(t, value, len);
    return to;
}

#ifndef __GLIBC__
void *memcpy(void *restrict to, const void *restrict from, size_t len)
    __attribute__((alias("vs_memory_copy")));
void *memset(void *to, int value, size_t len) __attribute__((alias("vs_memory_set")));
#endif
