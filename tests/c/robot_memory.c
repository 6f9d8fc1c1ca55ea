/* SPDX-License-Identifier: MIT */
/* memory.h against the C library's memmove, and against a plain loop: all alignments and lengths.
 * Where memory.c replaces the library's memcpy and memset they would be compared with themselves. */
#include "../../robot/memory.h"

#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "check.h"

enum { PLACES = 2 * sizeof(uintptr_t), LENGTHS = 200, ROOM = PLACES + LENGTHS + PLACES };

static uint8_t source[ROOM];
static uint8_t ours[ROOM];
static uint8_t theirs[ROOM];

static void refill(void)
{
    size_t i;

    for (i = 0; i < ROOM; i++) {
        source[i] = (uint8_t)(i * 7 + 1);
        ours[i] = theirs[i] = (uint8_t)~i;
    }
}

static void test_copy(size_t to, size_t from, size_t len)
{
    refill();
    memmove(theirs + to, source + from, len);
    CHECK(vs_memory_copy(ours + to, source + from, len) == ours + to);
    CHECK(memcmp(ours, theirs, ROOM) == 0);
}

static void test_set(size_t to, int value, size_t len)
{
    volatile uint8_t *plain = theirs + to;
    size_t i;

    refill();
    for (i = 0; i < len; i++)
        plain[i] = (uint8_t)value;
    CHECK(vs_memory_set(ours + to, value, len) == ours + to);
    CHECK(memcmp(ours, theirs, ROOM) == 0);
}

int main(void)
{
    size_t to;
    size_t from;
    size_t len;

    for (to = 0; to < PLACES; to++) {
        for (len = 0; len < LENGTHS; len++) {
            for (from = 0; from < PLACES; from++)
                test_copy(to, from, len);
            test_set(to, 0, len);
            test_set(to, 0xA5, len);
            test_set(to, -2, len); /* only its lowest byte counts */
        }
    }
    return 0;
}
