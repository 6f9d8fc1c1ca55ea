/* SPDX-License-Identifier: MIT */
#include "fw_body.h"

enum { BATTERY_MV = 4000, TICK_US = FW_WATCHDOG_TICK_MS * 1000 };

#define STEP_E12 INT64_C(1000000000000)

void fw_body_init(struct fw_body *body, int16_t max_steps_s, uint16_t timer_hz,
                  uint16_t timer_more)
{
    *body = (struct fw_body){.inputs = {.battery_mv = BATTERY_MV}};
    body->max_steps_s = max_steps_s;
    body->timer_hz = timer_hz;
    body->timer_more = timer_more;
}

void fw_body_reset(struct fw_body *body, uint64_t now_us)
{
    body->outputs = (struct fw_outputs){.leds = 0};
    body->steps_e12[0] = 0;
    body->steps_e12[1] = 0;
    body->rolled_us = now_us;
    body->applied_us = now_us;
    body->changed = 1;
    fw_watchdog_feed(&body->watchdog, 0);
}

/* The speed that a motor really turns with, in 1e-6 step/s. */
static int64_t real_speed_e6(const struct fw_body *body, int16_t steps_s)
{
    int64_t size = steps_s < 0 ? -(int64_t)steps_s : steps_s;
    int64_t real;

    if (size == 0)
        return 0;
    real = (int64_t)body->timer_hz * 1000000 / (body->timer_hz / size + body->timer_more);
    return steps_s < 0 ? -real : real;
}

static void roll(struct fw_body *body, uint64_t now_us)
{
    int64_t passed_us = (int64_t)(now_us - body->rolled_us);

    body->steps_e12[0] += real_speed_e6(body, body->outputs.left_steps_s) * passed_us;
    body->steps_e12[1] += real_speed_e6(body, body->outputs.right_steps_s) * passed_us;
    body->steps_e12[0] %= 65536 * STEP_E12;
    body->steps_e12[1] %= 65536 * STEP_E12;
    body->rolled_us = now_us;
}

static int16_t clamp(int32_t steps_s, int16_t max_steps_s)
{
    if (steps_s > max_steps_s)
        return max_steps_s;
    return (int16_t)(steps_s < -max_steps_s ? -max_steps_s : steps_s);
}

void fw_body_drive(struct fw_body *body, int32_t left_steps_s, int32_t right_steps_s,
                   uint64_t now_us)
{
    roll(body, now_us);
    body->outputs.left_steps_s = clamp(left_steps_s, body->max_steps_s);
    body->outputs.right_steps_s = clamp(right_steps_s, body->max_steps_s);
}

uint16_t fw_body_steps(struct fw_body *body, int wheel, uint64_t now_us)
{
    int64_t steps;

    roll(body, now_us);
    steps = body->steps_e12[wheel] / STEP_E12;
    return (uint16_t)((uint64_t)steps & 0xFFFFu);
}

void fw_body_set_steps(struct fw_body *body, int16_t left, int16_t right, uint64_t now_us)
{
    roll(body, now_us);
    body->steps_e12[0] = left * STEP_E12;
    body->steps_e12[1] = right * STEP_E12;
}

void fw_body_apply(struct fw_body *body, uint64_t now_us)
{
    body->applied_us = now_us;
    body->changed = 1;
}

int fw_body_take_change(struct fw_body *body)
{
    int changed = body->changed;

    body->changed = 0;
    return changed;
}

void fw_body_feed(struct fw_body *body, uint64_t now_us)
{
    fw_watchdog_feed(&body->watchdog, (uint16_t)(body->watchdog_us / TICK_US));
    body->ticked_us = now_us;
}

uint64_t fw_body_watchdog_due_us(const struct fw_body *body)
{
    if (body->watchdog.left == 0 ||
        (body->outputs.left_steps_s == 0 && body->outputs.right_steps_s == 0))
        return FW_NEVER_US;
    return body->ticked_us + (uint64_t)body->watchdog.left * TICK_US;
}

int fw_body_watch(struct fw_body *body, uint64_t now_us)
{
    int stands = body->outputs.left_steps_s == 0 && body->outputs.right_steps_s == 0;

    while (body->watchdog.left > 0 && now_us >= body->ticked_us + TICK_US) {
        body->ticked_us += TICK_US;
        if (!fw_watchdog_tick(&body->watchdog) || stands)
            continue;
        fw_body_drive(body, 0, 0, body->ticked_us);
        fw_body_apply(body, body->ticked_us);
        body->stops++;
        return 1;
    }
    return 0;
}
