/* SPDX-License-Identifier: MIT */
/*
 * vs_i2c_posix.h - the POSIX edge of the I2C seam: an adapter's /dev/i2c-N, or, for
 * emulated robots, a Unix socket that stands for one (firmware_bridge/README.md).
 */
#ifndef VS_I2C_POSIX_H
#define VS_I2C_POSIX_H

#include "vs_i2c.h"

#ifdef __cplusplus
extern "C" {
#endif

#define VS_I2C_UNIX "unix:" /* begins the path of a socket */

/*
 * Opens "/dev/i2c-12" or "unix:/path", kept from children, and lets bus work on *fd,
 * which has to outlive it. An adapter's time-out is set to VS_I2C_TIMEOUT_NS, that of
 * the adapters behind a multiplexer too. Another process that has the bus is waited
 * for, at the longest wait_ns.
 * VS_OK, VS_ERR_LOCKED, or VS_ERR_IO with errno set.
 */
int vs_i2c_open(struct vs_i2c *bus, const char *path, uint64_t wait_ns, int *fd);

/* 1 if the path is that of a socket. */
int vs_i2c_is_socket(const char *path);

#ifdef __cplusplus
}
#endif

#endif
