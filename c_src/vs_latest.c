/* SPDX-License-Identifier: MIT */
#include "vs_latest.h"

#include <string.h>

#include "vs_err.h"

#define SLOT_MASK 3u
#define NEW 4u /* the shared slot holds a value that was not read yet */

#ifdef VS_NO_ATOMICS

static uint32_t exchange(uint32_t *shared, uint32_t value)
{
    uint32_t old = *shared;

    *shared = value;
    return old;
}

static uint32_t peek(const uint32_t *shared)
{
    return *shared;
}

#else

#include <stdatomic.h>

/* Releases what the caller wrote to the slot it gives, and acquires what the other
 * side did to the slot it gets. */
static uint32_t exchange(_Atomic uint32_t *shared, uint32_t value)
{
    return atomic_exchange_explicit(shared, value, memory_order_acq_rel);
}

/* Only a hint whether an exchange is worth it: the exchange itself synchronises. */
static uint32_t peek(_Atomic uint32_t *shared)
{
    return atomic_load_explicit(shared, memory_order_relaxed);
}

#endif

void vs_latest_init(struct vs_latest *l, uint8_t *memory, size_t slot_size)
{
    memset(l, 0, sizeof *l);
    l->memory = memory;
    l->slot_size = slot_size;
    l->write_slot = 0;
    l->read_slot = 1;
    (void)exchange(&l->shared, 2);
}

uint8_t *vs_latest_write_begin(struct vs_latest *l)
{
    return l->memory + l->write_slot * l->slot_size;
}

int vs_latest_write_commit(struct vs_latest *l, uint32_t size, uint64_t capture_ns)
{
    struct vs_latest_stamp *stamp = &l->stamps[l->write_slot];

    if (size > l->slot_size)
        return VS_ERR_SPACE;
    stamp->capture_ns = capture_ns;
    stamp->sequence = ++l->sequence;
    stamp->size = size;
    l->write_slot = exchange(&l->shared, l->write_slot | NEW) & SLOT_MASK;
    return VS_OK;
}

const uint8_t *vs_latest_read(struct vs_latest *l, struct vs_latest_stamp *stamp)
{
    if (peek(&l->shared) & NEW) {
        l->read_slot = exchange(&l->shared, l->read_slot) & SLOT_MASK;
        l->has_value = 1;
    }
    if (!l->has_value) {
        memset(stamp, 0, sizeof *stamp);
        return NULL;
    }
    *stamp = l->stamps[l->read_slot];
    return l->memory + l->read_slot * l->slot_size;
}

uint64_t vs_latest_age_ns(const struct vs_latest_stamp *stamp, uint64_t now_ns)
{
    return now_ns > stamp->capture_ns ? now_ns - stamp->capture_ns : 0;
}
