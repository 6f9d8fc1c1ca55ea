/* SPDX-License-Identifier: MIT */
/*
 * fw_i2c.h - an emulated I2C bus at its real pace, 100 kHz: devices on it, transactions
 * that take their time, and faults. Freestanding; time is an argument.
 *
 * A device is a struct of functions. It is told of a transaction when that begins, with
 * the times at which its bytes are through; what it does then it does in its own
 * advance(). The next transaction begins when the one before is over.
 */
#ifndef FW_I2C_H
#define FW_I2C_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    FW_I2C_BYTE_US = 90,  /* [us] 8 bits and the acknowledgement */
    FW_I2C_EDGE_US = 20,  /* [us] START, repeated START or STOP */
    FW_I2C_DEVICES = 6
};

enum fw_i2c_result {
    FW_I2C_ACK = 0,
    FW_I2C_NACK = 1, /* nobody acknowledged */
    FW_I2C_STUCK = 2 /* a line is held low: the host's time-out ends the transaction */
};

struct fw_i2c_device {
    void *context;
    uint8_t address; /* 7 bits */

    /* Bytes that the host writes, the first of them through at first_us, each further one
     * FW_I2C_BYTE_US later. */
    enum fw_i2c_result (*write)(void *context, const uint8_t *buf, size_t len,
                                uint64_t first_us);

    /* Bytes that the host reads from first_us on. */
    enum fw_i2c_result (*read)(void *context, uint8_t *buf, size_t len, uint64_t first_us);

    /* A transaction was broken off. */
    void (*error)(void *context);
};

/* What goes wrong on the bus, each once: with the n-th transaction from now, 0 = not. */
struct fw_i2c_faults {
    uint32_t refuse;     /* it is not acknowledged, the device notes an error */
    uint32_t flip_write; /* a bit of what is written arrives wrong */
    uint32_t flip_read;  /* a bit of what is read arrives wrong */
};

struct fw_i2c {
    struct fw_i2c_faults faults; /* the owner writes */
    uint8_t stuck;               /* 1: a line is held low; the owner may write it, too */
    uint32_t transactions;
    uint32_t failed;             /* those without ACK */
    uint64_t free_us;            /* when the newest transaction is over */
    const struct fw_i2c_device *devices[FW_I2C_DEVICES];
    uint32_t count;
};

/* An empty bus. */
void fw_i2c_init(struct fw_i2c *bus);

/* Puts a device on the bus. Returns 0, or -1 if it has no room. */
int fw_i2c_add(struct fw_i2c *bus, const struct fw_i2c_device *device);

/* One transaction, asked for at now_us: writes out, then, after a repeated START, reads
 * in; either may be empty. bus->free_us says when it is over. */
enum fw_i2c_result fw_i2c_transfer(struct fw_i2c *bus, uint8_t address, const uint8_t *out,
                                   size_t out_len, uint8_t *in, size_t in_len, uint64_t now_us);

#ifdef __cplusplus
}
#endif

#endif
