/* SPDX-License-Identifier: MIT */
/*
 * fw_wifi.h - a stand-in for an e-puck2 on Wi-Fi (epuck_wifi.h), as freestanding C. It is no
 * firmware's own code: what is known of the radio's firmware are two programs that speak to it. It
 * sends its sensors every 25 ms while it is asked to, and drives on when its connection breaks.
 *
 * To be driven like fw_argos.h's; what carries the bytes, and how late, is the owner's.
 */
#ifndef FW_WIFI_H
#define FW_WIFI_H

#include <stddef.h>
#include <stdint.h>

#include "epuck_wifi.h"
#include "fw_body.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { FW_WIFI_PERIOD_US = 25000 /* [us] estimate: from one packet of sensors to the next */ };

struct fw_wifi {
    struct fw_body body;
    uint32_t packets;   /* commands since power on */
    uint64_t lived_us;
    uint64_t send_us;   /* when it sends next, FW_NEVER_US = it is not asked to */
    uint32_t got;       /* bytes of a command */
    uint8_t command[EPUCK_WIFI_COMMAND_LEN];
};

void fw_wifi_init(struct fw_wifi *fw);

/* A connection has begun, or the one that there was has ended: a half command is forgotten, and
 * nothing is sent. Motors do what they did. */
void fw_wifi_connect(struct fw_wifi *fw);

/* Switched off and on. */
void fw_wifi_reset(struct fw_wifi *fw, uint64_t now_us);

/* Takes bytes from the host at now_us. Returns how many: all. */
size_t fw_wifi_receive(struct fw_wifi *fw, const uint8_t *buf, size_t len, uint64_t now_us);

/* As fw_asercom_advance. */
int fw_wifi_advance(struct fw_wifi *fw, uint64_t now_us);

/* The packet that it sends at now_us, if it does. Returns its length, or 0. cap: at least 105. */
size_t fw_wifi_transmit(struct fw_wifi *fw, uint8_t *buf, size_t cap, uint64_t now_us);

uint64_t fw_wifi_due_us(const struct fw_wifi *fw);

#ifdef __cplusplus
}
#endif

#endif
