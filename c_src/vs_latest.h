/* SPDX-License-Identifier: MIT */
/*
 * vs_latest.h - the latest-value buffer: one writer thread, one reader thread,
 * neither ever waits, nothing is ever torn, the reader always gets the newest.
 * Three slots and one 32-bit atomic exchange: the writer owns one slot, the reader
 * one, and the third is handed over (two slots cannot do it: one side would have
 * to wait). With VS_NO_ATOMICS (single-threaded robot) plain memory.
 */
#ifndef VS_LATEST_H
#define VS_LATEST_H

#include <stddef.h>
#include <stdint.h>

#ifdef VS_NO_ATOMICS
#define VS_ATOMIC_U32 uint32_t
#else
#define VS_ATOMIC_U32 _Atomic uint32_t
#endif

#define VS_LATEST_SLOTS 3

/* What came with a value. */
struct vs_latest_stamp {
    uint64_t capture_ns; /* [ns] when the value was measured */
    uint32_t sequence;   /* 1.. of the values written; gaps = values never read */
    uint32_t size;       /* [byte] of the value */
};

/* Private to the functions below. */
struct vs_latest {
    VS_ATOMIC_U32 shared; /* index of the slot between the two, and whether it is new */
    uint32_t write_slot;  /* writer's */
    uint32_t sequence;    /* writer's */
    uint32_t read_slot;   /* reader's */
    uint32_t has_value;   /* reader's */
    size_t slot_size;     /* [byte] */
    uint8_t *memory;
    struct vs_latest_stamp stamps[VS_LATEST_SLOTS];
};

/* memory: VS_LATEST_SLOTS * slot_size bytes, owned by the caller, kept alive. */
void vs_latest_init(struct vs_latest *l, uint8_t *memory, size_t slot_size);

/* Writer: where to put the next value, slot_size bytes; stays the writer's until
 * committed, holds an arbitrary older value. */
uint8_t *vs_latest_write_begin(struct vs_latest *l);

/* Writer: makes the value in the slot the newest. Errors: VS_ERR_SPACE if size is
 * larger than a slot. */
int vs_latest_write_commit(struct vs_latest *l, uint32_t size, uint64_t capture_ns);

/* Reader: the newest value and its stamp, stable until the reader's next call;
 * NULL (*stamp zeroed) if nothing was written yet. */
const uint8_t *vs_latest_read(struct vs_latest *l, struct vs_latest_stamp *stamp);

/* Age [ns] of a stamped value; 0 if it was captured after now_ns. */
uint64_t vs_latest_age_ns(const struct vs_latest_stamp *stamp, uint64_t now_ns);

#endif
