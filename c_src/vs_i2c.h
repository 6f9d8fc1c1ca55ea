/* SPDX-License-Identifier: MIT */
/*
 * vs_i2c.h - the one seam between an I2C device's protocol and its bus: a struct of
 * functions. The daemon fills it from an adapter or a socket (vs_i2c_posix.h), tests
 * from memory and virtual time. Times are [ns] of one monotonic clock.
 */
#ifndef VS_I2C_H
#define VS_I2C_H

#include <stddef.h>
#include <stdint.h>

#include "vs_err.h"

#ifdef __cplusplus
extern "C" {
#endif

#define VS_I2C_TIMEOUT_NS 20000000u /* [ns] no transaction takes longer, stuck bus included */
#define VS_I2C_OUT_MAX 32           /* [byte] longest write */
#define VS_I2C_IN_MAX 64            /* [byte] longest read */

struct vs_i2c {
    void *context; /* handed to every function */

    uint64_t (*now_ns)(void *context);

    /* One transaction with the device at a 7-bit address: START, writes out, after a
     * repeated START reads in, STOP. Either may be empty, not both.
     * VS_OK; VS_ERR_SILENT: not acknowledged, or the bus is stuck; what of out has
     * arrived nobody knows; VS_ERR_IO: the adapter failed; VS_ERR_HANGUP: it is gone. */
    int (*transfer)(void *context, uint8_t address, const uint8_t *out, size_t out_len,
                    uint8_t *in, size_t in_len);

    uint32_t failures; /* how often the device was silent for vs_i2c_insist */
};

/* As transfer, up to three times while the device is silent. A try begins only if it
 * surely ends before deadline_ns; VS_ERR_BUSY if not even the first one could. */
int vs_i2c_insist(struct vs_i2c *bus, uint8_t address, const uint8_t *out, size_t out_len,
                  uint8_t *in, size_t in_len, uint64_t deadline_ns);

/* 1 if a transaction that begins now surely ends before deadline_ns. */
int vs_i2c_has_time(const struct vs_i2c *bus, uint64_t deadline_ns);

#ifdef __cplusplus
}
#endif

#endif
