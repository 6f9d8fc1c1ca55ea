/* SPDX-License-Identifier: MIT */
/*
 * fw_asercom.h - the microcontroller's end of GCtronic's advanced sercom
 * (epuck_asercom.h), as freestanding C: no operating system, no malloc, no clock.
 *
 * One loop reads bytes and waits for each without a time-out. A byte from 0x80 begins
 * a binary packet, one above 0 an ASCII line, 0 is ignored. Quirks that are kept:
 * - commands act as they are parsed, answers wait for the packet's end;
 * - an unknown code is skipped, but not its payload, which is then read as codes;
 * - a line that begins with CR or LF waits for its first other byte, whatever it is;
 * - answers differ in length between the two links, 'M' and the I2C commands are mute
 *   over the extension link, where their payload is not skipped either;
 * - at power on it resets itself once, so the banner may come twice.
 *
 * To be driven like fw_argos.h's.
 */
#ifndef FW_ASERCOM_H
#define FW_ASERCOM_H

#include <stddef.h>
#include <stdint.h>

#include "epuck_asercom.h"
#include "fw_body.h"
#include "fw_uart.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    FW_ASERCOM_BOOT_US = 100000,  /* [us] estimate: from reset to the banner */
    FW_ASERCOM_AGAIN_US = 50000,  /* [us] estimate: from the banner to the second reset */
    FW_ASERCOM_LINE_MAX = 80,     /* [byte] kept of an ASCII line */
    FW_ASERCOM_REPLY_MAX = 256    /* [byte] kept of a packet's answers */
};

enum fw_asercom_state {
    FW_ASERCOM_BOOT = 0,
    FW_ASERCOM_IDLE = 1,
    FW_ASERCOM_CODE = 2,    /* in a binary packet: waits for a code or the end */
    FW_ASERCOM_PAYLOAD = 3,
    FW_ASERCOM_NEWLINE = 4, /* of an ASCII line: waits for what is no CR or LF */
    FW_ASERCOM_LINE = 5
};

struct fw_asercom {
    struct fw_body body;
    struct fw_uart uart; /* its counters are the owner's to read, its faults to write */
    uint32_t packets;    /* binary packets completed since power on */
    const struct epuck_asercom_mode *mode;
    enum fw_asercom_state state;
    uint64_t reset_us;        /* when it resets itself once more, FW_NEVER_US = not */
    int16_t commanded[2];     /* left, right, as 'D' said */
    uint8_t code;             /* whose payload is being read */
    uint8_t payload[4];
    uint32_t got;             /* bytes of the payload or line */
    uint32_t wanted;
    char line[FW_ASERCOM_LINE_MAX];
    uint8_t reply[FW_ASERCOM_REPLY_MAX];
    uint32_t reply_len;
};

/* A microcontroller that was switched on long ago: idle, nothing to say. */
void fw_asercom_init(struct fw_asercom *fw, int mode);

/* Reset at now_us; again: it resets itself once more, as at power on. */
void fw_asercom_reset(struct fw_asercom *fw, int again, uint64_t now_us);

/* Puts bytes from the host on the line at now_us.
 * Returns how many fit (the line holds 256); offer the rest again later. */
size_t fw_asercom_receive(struct fw_asercom *fw, const uint8_t *buf, size_t len,
                          uint64_t now_us);

/* Lives on to now_us, or to the moment when the outputs may have changed.
 * Returns 1 then (body.outputs, body.applied_us; call again), 0 if it lived to now_us. */
int fw_asercom_advance(struct fw_asercom *fw, uint64_t now_us);

/* Takes the bytes that reached the host by now_us. Returns how many. */
size_t fw_asercom_transmit(struct fw_asercom *fw, uint8_t *buf, size_t cap,
                           uint64_t now_us);

/* When it pays to look again, UINT64_MAX if nothing is under way. */
uint64_t fw_asercom_due_us(const struct fw_asercom *fw);

#ifdef __cplusplus
}
#endif

#endif
