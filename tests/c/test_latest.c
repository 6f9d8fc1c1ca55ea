/* SPDX-License-Identifier: MIT */
/* The latest-value buffer with a writer and a reader in threads of their own, to be run
 * under ThreadSanitizer: nothing torn, nothing older than before, the last one arrives. */
#include <pthread.h>
#include <string.h>

#include "check.h"
#include "vs_err.h"
#include "vs_latest.h"

#define WORDS 64
#define VALUES 100000u

struct shared {
    struct vs_latest latest;
    uint8_t memory[VS_LATEST_SLOTS * WORDS * sizeof(uint32_t)];
};

static void *write_all(void *argument)
{
    struct shared *s = argument;
    uint32_t words[WORDS];
    uint32_t value;
    size_t i;

    for (value = 1; value <= VALUES; value++) {
        uint8_t *slot = vs_latest_write_begin(&s->latest);

        for (i = 0; i < WORDS; i++)
            words[i] = value;
        memcpy(slot, words, sizeof words);
        CHECK(vs_latest_write_commit(&s->latest, sizeof words, 1000ull * value) == VS_OK);
    }
    return NULL;
}

/* Reads once; returns the value's sequence, 0 if there is none yet. */
static uint32_t read_one(struct shared *s)
{
    struct vs_latest_stamp stamp;
    const uint8_t *slot = vs_latest_read(&s->latest, &stamp);
    uint32_t words[WORDS];
    size_t i;

    if (!slot)
        return 0;
    CHECK(stamp.size == sizeof words);
    CHECK(stamp.capture_ns == 1000ull * stamp.sequence);
    memcpy(words, slot, sizeof words);
    for (i = 0; i < WORDS; i++)
        CHECK(words[i] == stamp.sequence);
    return stamp.sequence;
}

int main(void)
{
    static struct shared s;
    pthread_t writer;
    uint32_t newest = 0;

    vs_latest_init(&s.latest, s.memory, WORDS * sizeof(uint32_t));
    CHECK(read_one(&s) == 0);
    CHECK(pthread_create(&writer, NULL, write_all, &s) == 0);
    while (newest < VALUES) {
        uint32_t sequence = read_one(&s);

        CHECK(sequence >= newest);
        newest = sequence;
    }
    CHECK(pthread_join(writer, NULL) == 0);
    CHECK(read_one(&s) == VALUES);
    return 0;
}
