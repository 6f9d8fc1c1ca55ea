/* SPDX-License-Identifier: MIT */
/* The latest-value buffer with a writer and a reader in threads of their own, to be run
 * under ThreadSanitizer: nothing torn, nothing twice, nothing older, the last one arrives. */
#include <pthread.h>
#include <string.h>

#include "check.h"
#include "vs_latest.h"

#define WORDS 64
#define VALUES 100000u

struct shared {
    struct vs_latest latest;
    uint32_t slots[VS_LATEST_SLOTS][WORDS];
};

static void *write_all(void *argument)
{
    struct shared *s = argument;
    uint32_t value;
    size_t i;

    for (value = 1; value <= VALUES; value++) {
        uint32_t *words = s->slots[vs_latest_write_slot(&s->latest)];

        for (i = 0; i < WORDS; i++)
            words[i] = value;
        vs_latest_write_commit(&s->latest);
    }
    return NULL;
}

/* Reads once and clears what was read; returns the value, 0 if there is no new one. */
static uint32_t read_one(struct shared *s)
{
    int32_t slot = vs_latest_read(&s->latest);
    uint32_t value;
    size_t i;

    if (slot < 0)
        return 0;
    value = s->slots[slot][0];
    for (i = 0; i < WORDS; i++)
        CHECK(s->slots[slot][i] == value);
    memset(s->slots[slot], 0, sizeof s->slots[slot]);
    return value;
}

int main(void)
{
    static struct shared s;
    pthread_t writer;
    uint32_t newest = 0;

    vs_latest_init(&s.latest);
    CHECK(read_one(&s) == 0);
    CHECK(pthread_create(&writer, NULL, write_all, &s) == 0);
    while (newest < VALUES) {
        uint32_t value = read_one(&s);

        CHECK(value == 0 || value > newest);
        newest = value ? value : newest;
    }
    CHECK(pthread_join(writer, NULL) == 0);
    CHECK(read_one(&s) == 0);
    return 0;
}
