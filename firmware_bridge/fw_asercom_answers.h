/* SPDX-License-Identifier: MIT */
/* fw_asercom_answers.h - what the binary commands of fw_asercom.h bring along, and what they
 * answer. Internal. */
#ifndef FW_ASERCOM_ANSWERS_H
#define FW_ASERCOM_ANSWERS_H

#include "fw_asercom.h"

enum { FW_ASERCOM_SET_STEPS = 0xB0 }; /* 'P' */

static inline int fw_asercom_is_extension(const struct fw_asercom *fw)
{
    return fw->mode == &epuck_asercom_modes[EPUCK_ASERCOM_EXTENSION];
}

/* Bytes of a code's payload. */
uint32_t fw_asercom_payload(const struct fw_asercom *fw, uint8_t code);

/* Adds to the packet's answer. */
void fw_asercom_answer(struct fw_asercom *fw, uint8_t code);

#endif
