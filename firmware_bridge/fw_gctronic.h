/* SPDX-License-Identifier: MIT */
/*
 * fw_gctronic.h - the microcontroller's end of GCtronic's I2C packet
 * (epuck_gctronic.h), as freestanding C. Quirks that are kept:
 * - the answer is composed when a write ends; a read alone gets the one before, at first
 *   47 zeros;
 * - a short write leaves the tail of the packet before it;
 * - a bad checksum only means that the packet is not applied; after an error on the bus
 *   the next packet is not applied either, however good it is;
 * - it never stops by itself, but for the watchdog of fw_body.h, where it is built in.
 */
#ifndef FW_GCTRONIC_H
#define FW_GCTRONIC_H

#include <stddef.h>
#include <stdint.h>

#include "epuck_gctronic.h"
#include "fw_body.h"
#include "fw_i2c.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { FW_GCTRONIC_BOOT_US = 500000 }; /* [us] estimate: nobody acknowledges after a reset */

struct fw_gctronic {
    struct fw_body body;
    struct fw_i2c_device device; /* to be put on a bus; the struct must not move then */
    uint32_t packets;            /* applied since power on */
    uint32_t dropped;            /* not applied: checksum, or after an error */
    uint8_t had_error;
    uint8_t has_packet;          /* to be applied at packet_us */
    uint64_t packet_us;
    uint64_t booted_us;          /* it acknowledges from then on */
    uint8_t received[EPUCK_GCTRONIC_ACTUATOR_LEN];
    uint8_t answer[EPUCK_GCTRONIC_SENSOR_LEN];
};

/* Power on, long ago. */
void fw_gctronic_init(struct fw_gctronic *fw);

/* Reset at now_us. */
void fw_gctronic_reset(struct fw_gctronic *fw, uint64_t now_us);

/* Lives on to now_us. Returns 1 if the outputs may have changed since the last call
 * (body.outputs, body.applied_us), else 0. */
int fw_gctronic_advance(struct fw_gctronic *fw, uint64_t now_us);

/* When it pays to look again, UINT64_MAX if nothing is under way. */
uint64_t fw_gctronic_due_us(const struct fw_gctronic *fw);

#ifdef __cplusplus
}
#endif

#endif
