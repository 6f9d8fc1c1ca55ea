/* SPDX-License-Identifier: MIT */
#include "fw_york.h"

#include "epuck_bytes.h"

enum {
    OTHER_MASK = 3,
    LOW_BYTE = 0xFF,
    TIMER_HZ = 57600,       /* FCY / 256, and a dsPIC counts from 0: pi-puck-e-puck1 0041716
                               pi-puck-e-puck1.X/motors.c:187-193 */
    EPUCK2_TIMER_HZ = 50000 /* e-puck2_main-processor fcb74b1 src/motors.c:193-229 */
};

static uint64_t byte_us(const struct fw_york *fw, int index)
{
    return fw->first_us + (uint64_t)index * FW_I2C_BYTE_US;
}

/* Stores the bytes that have come by now_us. */
static void store(struct fw_york *fw, uint64_t now_us)
{
    uint16_t *at = &fw->registers[fw->pointer];

    while (fw->stored < fw->expected && byte_us(fw, fw->stored) <= now_us) {
        uint8_t byte = fw->incoming[fw->stored];

        *at = (uint16_t)(fw->stored == 0 ? byte : *at | (uint16_t)(byte << 8));
        fw->stored++;
        fw->dirty = 1;
    }
}

static int32_t signed_register(const struct fw_york *fw, uint8_t number)
{
    uint8_t bytes[2];

    epuck_put_u16(bytes, fw->registers[number]);
    return epuck_get_s16(bytes);
}

/* One round of the main loop. */
static void loop(struct fw_york *fw, uint64_t now_us)
{
    struct fw_body *body = &fw->body;
    struct fw_outputs was = body->outputs;
    struct fw_outputs *is = &body->outputs;

    fw_body_drive(body, signed_register(fw, EPUCK_YORK_LEFT_SPEED),
                  signed_register(fw, EPUCK_YORK_RIGHT_SPEED), now_us);
    fw->registers[EPUCK_YORK_LEFT_SPEED] = (uint16_t)is->left_steps_s;
    fw->registers[EPUCK_YORK_RIGHT_SPEED] = (uint16_t)is->right_steps_s;
    fw->registers[EPUCK_YORK_RING_LEDS] &= LOW_BYTE;
    fw->registers[EPUCK_YORK_OTHER_LEDS] &= OTHER_MASK;
    fw->registers[EPUCK_YORK_SENSING] &= 1;
    if (fw->registers[EPUCK_YORK_SENSING] == 0)
        fw->sensing_us = FW_NEVER_US;
    else if (fw->sensing_us == FW_NEVER_US)
        fw->sensing_us = now_us;
    is->leds = epuck_york_get_leds(fw->registers[EPUCK_YORK_RING_LEDS],
                                   fw->registers[EPUCK_YORK_OTHER_LEDS]);
    if (is->left_steps_s == was.left_steps_s && is->right_steps_s == was.right_steps_s &&
        is->leds == was.leds)
        return;
    fw->torn += fw->stored < fw->expected && (fw->pointer == EPUCK_YORK_LEFT_SPEED ||
                                              fw->pointer == EPUCK_YORK_RIGHT_SPEED);
    fw_body_apply(body, now_us);
}

static void watch(struct fw_york *fw, uint64_t now_us)
{
    if (!fw_body_watch(&fw->body, now_us))
        return;
    fw->registers[EPUCK_YORK_LEFT_SPEED] = 0;
    fw->registers[EPUCK_YORK_RIGHT_SPEED] = 0;
}

static uint64_t next_loop_us(const struct fw_york *fw)
{
    return (fw->lived_us / FW_YORK_LOOP_US + 1) * FW_YORK_LOOP_US;
}

/* Rounds of the loop that would find everything as it was are left out. */
static void live(struct fw_york *fw, uint64_t now_us)
{
    while (fw->dirty || fw->stored < fw->expected) {
        uint64_t at_us = next_loop_us(fw);

        if (at_us > now_us)
            break;
        watch(fw, at_us);
        store(fw, at_us);
        fw->dirty = 0;
        loop(fw, at_us);
        fw->lived_us = at_us;
    }
    watch(fw, now_us);
    if (!fw->dirty && fw->stored == fw->expected && fw->lived_us < now_us)
        fw->lived_us = now_us;
}

/* A register of an e-puck2 as it is sent: its low bytes. Returns how many, 0: it does not
 * answer. */
static uint8_t answer_of(struct fw_york *fw, uint8_t number, uint64_t now_us, uint16_t *value)
{
    const struct fw_inputs *inputs = &fw->body.inputs;

    if (number <= EPUCK_YORK_RIGHT_SPEED) {
        *value = fw->registers[number];
        return number <= EPUCK_YORK_OTHER_LEDS ? 1 : 2;
    }
    if (number == EPUCK_YORK_SENSING || number >= EPUCK_YORK_REGISTERS)
        return 0;
    if (number >= EPUCK_YORK_LIGHT)
        *value = (uint16_t)inputs->light[number - EPUCK_YORK_LIGHT];
    else if (number >= EPUCK_YORK_PROX)
        *value = inputs->prox[number - EPUCK_YORK_PROX] < 0
                     ? 0 : (uint16_t)inputs->prox[number - EPUCK_YORK_PROX];
    else
        *value = fw_body_steps(&fw->body, number - EPUCK_YORK_LEFT_STEPS, now_us);
    return 2;
}

static int16_t clamp(int16_t steps_s)
{
    if (steps_s > EPUCK_YORK_SPEED_MAX)
        return EPUCK_YORK_SPEED_MAX;
    return steps_s < -EPUCK_YORK_SPEED_MAX ? -EPUCK_YORK_SPEED_MAX : steps_s;
}

/* The thread of an e-puck2 that applies what was written. */
static void obey(struct fw_york *fw, uint8_t number, uint64_t now_us)
{
    struct fw_body *body = &fw->body;
    int16_t left = body->outputs.left_steps_s;
    int16_t right = body->outputs.right_steps_s;
    uint16_t leds = epuck_york_get_leds(fw->registers[EPUCK_YORK_RING_LEDS],
                                        fw->registers[EPUCK_YORK_OTHER_LEDS]);
    uint16_t others = number == EPUCK_YORK_RING_LEDS ? (uint16_t)~LOW_BYTE : LOW_BYTE;

    if (fw->had_error) {
        fw->had_error = 0;
        fw->dropped++;
        return;
    }
    if (number == EPUCK_YORK_LEFT_SPEED)
        left = (int16_t)signed_register(fw, number);
    else if (number == EPUCK_YORK_RIGHT_SPEED)
        right = (int16_t)signed_register(fw, number);
    else
        body->outputs.leds = (uint16_t)((body->outputs.leds & others) | (leds & ~others));
    fw_body_drive(body, left, right, now_us);
    fw_body_apply(body, now_us);
    fw_body_feed(body, now_us);
}

/* A message to an e-puck2 has ended: a number alone asks, more of it writes. */
static void take_message(struct fw_york *fw, size_t len, uint64_t now_us)
{
    uint8_t number = fw->received[0];
    uint16_t value = fw->received[1];

    if (len == 1) {
        uint8_t count = answer_of(fw, number, now_us, &value);

        if (count == 0)
            return;
        epuck_put_u16(fw->answer, value);
        fw->answer_len = count;
    } else if (number <= EPUCK_YORK_RIGHT_SPEED) {
        if (number >= EPUCK_YORK_LEFT_SPEED)
            value = (uint16_t)clamp(epuck_get_s16(fw->received + 1));
        fw->registers[number] = value;
        fw->writes++;
        obey(fw, number, now_us);
    }
}

static enum fw_i2c_result write_epuck2(struct fw_york *fw, const uint8_t *buf, size_t len,
                                       uint64_t first_us)
{
    size_t i;

    fw->body.timer_hz = EPUCK2_TIMER_HZ;
    fw->body.timer_more = 0;
    watch(fw, first_us);
    for (i = 0; i < len && i < sizeof fw->received; i++)
        fw->received[i] = buf[i];
    take_message(fw, len, first_us + (len - 1) * FW_I2C_BYTE_US);
    return FW_I2C_ACK;
}

static enum fw_i2c_result write(void *context, const uint8_t *buf, size_t len, uint64_t first_us)
{
    struct fw_york *fw = context;
    size_t i;

    if (fw->is_epuck2)
        return first_us < fw->booted_us ? FW_I2C_NACK : write_epuck2(fw, buf, len, first_us);
    live(fw, first_us);
    store(fw, first_us);
    if (first_us < fw->booted_us || len > EPUCK_YORK_WRITE_LEN)
        return FW_I2C_NACK;
    fw_body_feed(&fw->body, first_us); /* whatever is written: speeds are when they change */
    fw->pointer = buf[0];
    fw->stored = 0;
    fw->expected = (uint8_t)(len - 1);
    for (i = 1; i < len; i++)
        fw->incoming[i - 1] = buf[i];
    fw->first_us = first_us + FW_I2C_BYTE_US;
    if (len == 1)
        return FW_I2C_ACK;
    fw->writes++;
    return FW_I2C_ACK;
}

static uint16_t tear(struct fw_york *fw, uint16_t steps)
{
    if (fw->tear == 0)
        return steps;
    fw->tear--;
    return fw->tear == 0 ? (uint16_t)(steps - 0x100) : steps;
}

/* 1 if a sensor's register holds something that was measured. */
static int has_sensed(const struct fw_york *fw, uint8_t number, uint64_t now_us)
{
    uint64_t pair = (uint64_t)(number - EPUCK_YORK_PROX) % 4;

    return fw->sensing_us != FW_NEVER_US &&
           now_us >= fw->sensing_us + FW_YORK_FIRST_US + pair * FW_YORK_PAIR_US;
}

/* What a register holds now; those of the sensors are the loop's. */
static uint16_t value_of(struct fw_york *fw, uint8_t number, uint64_t now_us)
{
    const struct fw_inputs *inputs = &fw->body.inputs;

    if (number == EPUCK_YORK_LEFT_STEPS || number == EPUCK_YORK_RIGHT_STEPS)
        return tear(fw, fw_body_steps(&fw->body, number - EPUCK_YORK_LEFT_STEPS, now_us));
    if (number < EPUCK_YORK_PROX || number >= EPUCK_YORK_REGISTERS)
        return fw->registers[number];
    if (!has_sensed(fw, number, now_us))
        return number < EPUCK_YORK_LIGHT ? 0 : EPUCK_YORK_RAW_MAX;
    if (number < EPUCK_YORK_LIGHT)
        return (uint16_t)inputs->prox[number - EPUCK_YORK_PROX];
    return (uint16_t)(EPUCK_YORK_RAW_MAX - inputs->light[number - EPUCK_YORK_LIGHT]);
}

static enum fw_i2c_result read(void *context, uint8_t *buf, size_t len, uint64_t first_us)
{
    struct fw_york *fw = context;
    uint8_t bytes[3] = {0};
    size_t i;

    live(fw, first_us);
    store(fw, first_us);
    if (first_us < fw->booted_us)
        return FW_I2C_NACK;
    if (fw->is_epuck2) {
        for (i = 0; i < len; i++)
            buf[i] = fw->answer[i < fw->answer_len ? i : fw->answer_len - 1u];
        return FW_I2C_ACK;
    }
    if (len > EPUCK_YORK_READ_LEN)
        return FW_I2C_STUCK;
    bytes[0] = fw->left_over;
    epuck_put_u16(bytes + fw->has_left_over, value_of(fw, fw->pointer, first_us));
    buf[0] = bytes[0];
    if (len == 2)
        buf[1] = bytes[1];
    fw->left_over = bytes[len];
    fw->has_left_over = (uint8_t)(fw->has_left_over + 2u - len > 0);
    return FW_I2C_ACK;
}

/* The interrupt of an e-puck keeps no errors. */
static void error(void *context)
{
    struct fw_york *fw = context;

    fw->had_error = fw->is_epuck2;
}

void fw_york_init(struct fw_york *fw)
{
    *fw = (struct fw_york){.answer_len = 1, .sensing_us = FW_NEVER_US};
    fw_body_init(&fw->body, EPUCK_YORK_SPEED_MAX, TIMER_HZ, 1);
    fw->device = (struct fw_i2c_device){fw, EPUCK_YORK_ADDRESS, write, read, error};
}

void fw_york_reset(struct fw_york *fw, uint64_t now_us)
{
    int i;

    fw_body_reset(&fw->body, now_us);
    for (i = 0; i < FW_YORK_REGISTERS; i++)
        fw->registers[i] = 0;
    fw->expected = fw->stored = 0;
    fw->has_left_over = 0;
    fw->sensing_us = FW_NEVER_US;
    fw->had_error = 0;
    fw->answer[0] = 0;
    fw->answer_len = 1;
    fw->dirty = 0;
    fw->lived_us = now_us;
    fw->booted_us = now_us + FW_YORK_BOOT_US;
}

int fw_york_advance(struct fw_york *fw, uint64_t now_us)
{
    live(fw, now_us);
    return fw_body_take_change(&fw->body);
}

uint64_t fw_york_due_us(const struct fw_york *fw)
{
    uint64_t watchdog_us = fw_body_watchdog_due_us(&fw->body);
    uint64_t loop_us = FW_NEVER_US;

    if (fw->dirty || fw->stored < fw->expected)
        loop_us = next_loop_us(fw);
    return loop_us < watchdog_us ? loop_us : watchdog_us;
}
