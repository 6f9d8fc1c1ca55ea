/* SPDX-License-Identifier: MIT */
#include "vs_latest.h"

#include <stdatomic.h>

#define SLOT_MASK 3u
#define NEW 4u /* the shared slot was committed and not read yet */

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

void vs_latest_init(struct vs_latest *l)
{
    l->write_slot = 0;
    l->read_slot = 1;
    (void)exchange(&l->shared, 2);
}

uint32_t vs_latest_write_slot(const struct vs_latest *l)
{
    return l->write_slot;
}

void vs_latest_write_commit(struct vs_latest *l)
{
    l->write_slot = exchange(&l->shared, l->write_slot | NEW) & SLOT_MASK;
}

int32_t vs_latest_read(struct vs_latest *l)
{
    if (!(peek(&l->shared) & NEW))
        return -1;
    l->read_slot = exchange(&l->shared, l->read_slot) & SLOT_MASK;
    return (int32_t)l->read_slot;
}
