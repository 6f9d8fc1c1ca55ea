/* SPDX-License-Identifier: MIT */
/*
 * vs_latest.h - the double buffer's exchange: one writer thread, one reader thread,
 * neither ever waits, nothing is ever torn, the reader always gets the newest.
 * Three slots and one 32-bit atomic exchange: the writer owns one slot, the reader
 * one, and the third is handed over (two slots cannot do it: one side would have
 * to wait). Only slot numbers are exchanged; what a slot holds is the caller's, and
 * may be read and written by the slot's owner only.
 */
#ifndef VS_LATEST_H
#define VS_LATEST_H

#include <stdint.h>

#define VS_LATEST_SLOTS 3

/* Private to the functions below. */
struct vs_latest {
    _Atomic uint32_t shared; /* the slot between the two, and whether it is new */
    uint32_t write_slot;     /* writer's */
    uint32_t read_slot;      /* reader's */
};

/* Before both threads: nothing is new. */
void vs_latest_init(struct vs_latest *l);

/* Writer: its slot, 0 to VS_LATEST_SLOTS - 1; stays its own until committed. */
uint32_t vs_latest_write_slot(const struct vs_latest *l);

/* Writer: makes its slot the newest, and gets another one, which the reader has
 * done with or never saw. */
void vs_latest_write_commit(struct vs_latest *l);

/* Reader: gives its slot back and gets the newest one, which stays its own until
 * the call that returns another; -1 if nothing was committed since, and it keeps
 * its slot. */
int32_t vs_latest_read(struct vs_latest *l);

#endif
