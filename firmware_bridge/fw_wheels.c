/* SPDX-License-Identifier: MIT */
#include "fw_wheels.h"

enum { TIMER_HZ = 50000 };

void fw_wheels_init(struct fw_wheels *fw, int16_t max_steps_s)
{
    *fw = (struct fw_wheels){.orders = 0};
    fw_body_init(&fw->body, max_steps_s, TIMER_HZ, 0);
}

void fw_wheels_drive(struct fw_wheels *fw, int32_t left_steps_s, int32_t right_steps_s,
                     uint64_t now_us)
{
    fw->orders++;
    fw_body_drive(&fw->body, left_steps_s, right_steps_s, now_us);
    fw_body_feed(&fw->body, now_us);
    fw_body_apply(&fw->body, now_us);
}

int fw_wheels_advance(struct fw_wheels *fw, uint64_t now_us)
{
    (void)fw_body_watch(&fw->body, now_us);
    return fw_body_take_change(&fw->body);
}

uint64_t fw_wheels_due_us(const struct fw_wheels *fw)
{
    return fw_body_watchdog_due_us(&fw->body);
}
