/* SPDX-License-Identifier: MIT */
#include "fw_gctronic.h"

#include "epuck_bytes.h"

/* Two microsteps of 100 kHz a step. Source: e-puck2_main-processor 517ef07 src/motors.c:193-229. */
enum { TIMER_HZ = 50000 };

/* A packet has come: the thread that applies packets is woken. */
static void wake(struct fw_gctronic *fw, uint64_t at_us)
{
    struct epuck_gctronic_actuators unused;

    if (fw->had_error || epuck_gctronic_get_actuators(fw->received, &unused) != 0) {
        fw->had_error = 0;
        fw->dropped++;
        return;
    }
    fw->has_packet = 1;
    fw->packet_us = at_us;
}

static void apply(struct fw_gctronic *fw)
{
    struct epuck_gctronic_actuators actuators;
    struct fw_body *body = &fw->body;
    int i;

    fw->has_packet = 0;
    if (epuck_gctronic_get_actuators(fw->received, &actuators) != 0)
        return;
    fw_body_drive(body, actuators.left_steps_s, actuators.right_steps_s, fw->packet_us);
    fw_body_feed(body, fw->packet_us);
    body->outputs.leds = actuators.leds;
    for (i = 0; i < 3 * EPUCK_GCTRONIC_RGB_LEDS; i++)
        body->outputs.rgb[i / 3][i % 3] = actuators.rgb[i / 3][i % 3];
    fw_body_apply(body, fw->packet_us);
    fw->packets++;
}

static void live(struct fw_gctronic *fw, uint64_t now_us)
{
    int is_due = fw->has_packet && fw->packet_us <= now_us;

    (void)fw_body_watch(&fw->body, is_due ? fw->packet_us : now_us);
    if (is_due)
        apply(fw);
}

static void compose(struct fw_gctronic *fw, uint64_t at_us)
{
    const struct fw_inputs *inputs = &fw->body.inputs;
    struct epuck_gctronic_sensors sensors;
    int i;

    for (i = 0; i < 8; i++) {
        sensors.prox[i] = inputs->prox[i];
        sensors.light[i] = inputs->light[i];
    }
    for (i = 0; i < 4; i++)
        sensors.microphones[i] = inputs->microphones[i];
    sensors.steps[0] = fw_body_steps(&fw->body, 0, at_us);
    sensors.steps[1] = fw_body_steps(&fw->body, 1, at_us);
    epuck_gctronic_put_sensors(&sensors, fw->answer);
}

static enum fw_i2c_result write(void *context, const uint8_t *buf, size_t len, uint64_t first_us)
{
    struct fw_gctronic *fw = context;
    uint64_t end_us = first_us + (len - 1) * FW_I2C_BYTE_US;
    size_t i;

    live(fw, first_us);
    if (first_us < fw->booted_us || len > sizeof fw->received)
        return FW_I2C_NACK;
    for (i = 0; i < len; i++)
        fw->received[i] = buf[i];
    compose(fw, end_us);
    wake(fw, end_us);
    return FW_I2C_ACK;
}

static enum fw_i2c_result read(void *context, uint8_t *buf, size_t len, uint64_t first_us)
{
    const struct fw_gctronic *fw = context;
    size_t i;

    if (first_us < fw->booted_us)
        return FW_I2C_NACK;
    for (i = 0; i < len; i++)
        buf[i] = i < sizeof fw->answer ? fw->answer[i] : 0;
    return FW_I2C_ACK;
}

static void error(void *context)
{
    struct fw_gctronic *fw = context;

    fw->had_error = 1;
}

void fw_gctronic_init(struct fw_gctronic *fw)
{
    *fw = (struct fw_gctronic){0};
    fw_body_init(&fw->body, EPUCK_GCTRONIC_SPEED_MAX, TIMER_HZ, 0);
    fw->device = (struct fw_i2c_device){fw, EPUCK_GCTRONIC_ADDRESS, write, read, error};
}

void fw_gctronic_reset(struct fw_gctronic *fw, uint64_t now_us)
{
    fw_body_reset(&fw->body, now_us);
    fw->had_error = 0;
    fw->has_packet = 0;
    fw->booted_us = now_us + FW_GCTRONIC_BOOT_US;
    epuck_zero(fw->received, sizeof fw->received);
    epuck_zero(fw->answer, sizeof fw->answer);
}

int fw_gctronic_advance(struct fw_gctronic *fw, uint64_t now_us)
{
    live(fw, now_us);
    return fw_body_take_change(&fw->body);
}

uint64_t fw_gctronic_due_us(const struct fw_gctronic *fw)
{
    uint64_t watchdog_us = fw_body_watchdog_due_us(&fw->body);

    return fw->has_packet && fw->packet_us < watchdog_us ? fw->packet_us : watchdog_us;
}
