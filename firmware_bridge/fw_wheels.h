/* SPDX-License-Identifier: MIT */
/*
 * fw_wheels.h - a robot whose firmware is none of an e-puck's: somebody else speaks for it, and
 * says what its wheels do. Freestanding; to be driven like fw_argos.h's.
 */
#ifndef FW_WHEELS_H
#define FW_WHEELS_H

#include "fw_body.h"

#ifdef __cplusplus
extern "C" {
#endif

struct fw_wheels {
    struct fw_body body;
    uint32_t orders;   /* since power on */
};

/* max_steps_s: what its motors can do. */
void fw_wheels_init(struct fw_wheels *fw, int16_t max_steps_s);

/* Its wheels are told these speeds at now_us. */
void fw_wheels_drive(struct fw_wheels *fw, int32_t left_steps_s, int32_t right_steps_s,
                     uint64_t now_us);

/* As fw_asercom_advance. */
int fw_wheels_advance(struct fw_wheels *fw, uint64_t now_us);

uint64_t fw_wheels_due_us(const struct fw_wheels *fw);

#ifdef __cplusplus
}
#endif

#endif
