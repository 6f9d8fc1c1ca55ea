/* SPDX-License-Identifier: MIT */
#include "fw_argos.h"

enum { MOTOR_MAX_STEPS_S = 1000, RING_LED_MASK = 0xFF };

#define NS_PER_US 1000u

static int16_t clamp(int16_t steps_s)
{
    if (steps_s > MOTOR_MAX_STEPS_S)
        return MOTOR_MAX_STEPS_S;
    return steps_s < -MOTOR_MAX_STEPS_S ? -MOTOR_MAX_STEPS_S : steps_s;
}

static void wait_for_host(struct fw_argos *fw)
{
    fw->outputs.leds &= (uint16_t)~RING_LED_MASK;
    fw->state = FW_ARGOS_WAKE;
}

void fw_argos_init(struct fw_argos *fw)
{
    *fw = (struct fw_argos){0};
    fw_line_init(&fw->rx, EPUCK_ARGOS_BYTE_NS);
    fw_line_init(&fw->tx, EPUCK_ARGOS_BYTE_NS);
    wait_for_host(fw);
}

static void send_sensors(struct fw_argos *fw, uint64_t now_ns)
{
    uint8_t frame[EPUCK_ARGOS_SENSOR_LEN];

    if (fw->sample)
        fw->sample(fw->context, now_ns / NS_PER_US, &fw->inputs);
    epuck_argos_put_sensors(&fw->inputs, frame);
    fw->unsent += (uint32_t)(sizeof frame - fw_line_put(&fw->tx, frame, sizeof frame, now_ns));
    fw->busy_until_ns = fw->tx.free_ns;
    fw->sending = 1;
}

static void apply(struct fw_argos *fw, uint64_t now_ns)
{
    struct epuck_argos_actuators new;

    epuck_argos_get_actuators(fw->frame, &new);
    if (new.left_steps_s != fw->old.left_steps_s)
        fw->outputs.left_steps_s = clamp(new.left_steps_s);
    if (new.right_steps_s != fw->old.right_steps_s)
        fw->outputs.right_steps_s = clamp(new.right_steps_s);
    fw->outputs.leds ^= (uint16_t)(new.leds ^ fw->old.leds);
    fw->old = new;
    fw->frames++;
    fw->applied_us = now_ns / NS_PER_US;
    if (new.reset == EPUCK_ARGOS_RESET)
        wait_for_host(fw);
    else if (new.ircom_enable)
        fw->busy_until_ns = now_ns + (uint64_t)FW_ARGOS_IRCOM_US * NS_PER_US;
    else
        send_sensors(fw, now_ns);
}

/* What kept the program from its ring is over. */
static void idle(struct fw_argos *fw, uint64_t now_ns)
{
    fw->busy_until_ns = 0;
    if (!fw->sending)
        send_sensors(fw, now_ns);
    else
        fw->sending = 0;
}

/* Returns 1 if the byte completed an actuator frame. */
static int consume(struct fw_argos *fw, uint8_t byte, uint64_t now_ns)
{
    if (fw->state == FW_ARGOS_WAKE) {
        fw->state = FW_ARGOS_CONFIG;
        fw->got = 0;
        return 0;
    }
    if (fw->state == FW_ARGOS_CONFIG) {
        fw->got++;
        if (fw->got == EPUCK_ARGOS_CONFIG_LEN) {
            fw->state = FW_ARGOS_FRAME;
            fw->got = 0;
            send_sensors(fw, now_ns);
        }
        return 0;
    }
    fw->frame[fw->got] = byte;
    fw->got++;
    if (fw->got < EPUCK_ARGOS_ACTUATOR_LEN)
        return 0;
    fw->got = 0;
    apply(fw, now_ns);
    return 1;
}

static void interrupt(struct fw_argos *fw, uint8_t byte)
{
    if (fw->sending)
        fw->overlapped++;
    fw->ring[fw->ring_write] = byte;
    fw->ring_write = (fw->ring_write + 1) % FW_ARGOS_RING;
    if (fw->ring_write == fw->ring_read)
        fw->overflowed += FW_ARGOS_RING;
}

size_t fw_argos_receive(struct fw_argos *fw, const uint8_t *buf, size_t len,
                        uint64_t now_us)
{
    return fw_line_put(&fw->rx, buf, len, now_us * NS_PER_US);
}

/* Drains the receive ring until the program is busy. Returns 1 at the first frame. */
static int run_program(struct fw_argos *fw)
{
    while (fw->busy_until_ns == 0 && fw->ring_read != fw->ring_write) {
        uint8_t byte = fw->ring[fw->ring_read];

        fw->ring_read = (fw->ring_read + 1) % FW_ARGOS_RING;
        if (consume(fw, byte, fw->lived_ns))
            return 1;
    }
    return 0;
}

int fw_argos_advance(struct fw_argos *fw, uint64_t now_us)
{
    while (!run_program(fw)) {
        uint64_t at_ns = fw_line_next_ns(&fw->rx);
        int free_first = fw->busy_until_ns != 0 && fw->busy_until_ns <= at_ns;
        uint8_t byte;

        if (free_first)
            at_ns = fw->busy_until_ns;
        if (at_ns > now_us * NS_PER_US)
            return 0;
        fw->lived_ns = at_ns;
        if (free_first)
            idle(fw, at_ns);
        else if (fw_line_get(&fw->rx, at_ns, &byte))
            interrupt(fw, byte);
    }
    return 1;
}

size_t fw_argos_transmit(struct fw_argos *fw, uint8_t *buf, size_t cap,
                         uint64_t now_us)
{
    size_t len = 0;

    while (len < cap && fw_line_get(&fw->tx, now_us * NS_PER_US, &buf[len]))
        len++;
    return len;
}

static uint64_t all_through_ns(const struct fw_line *line)
{
    return line->count == 0 ? UINT64_MAX : line->free_ns;
}

uint64_t fw_argos_due_us(const struct fw_argos *fw)
{
    uint64_t rx_ns = all_through_ns(&fw->rx);
    uint64_t tx_ns = all_through_ns(&fw->tx);
    uint64_t due_ns = rx_ns < tx_ns ? rx_ns : tx_ns;

    if (fw->busy_until_ns != 0 && fw->busy_until_ns < due_ns)
        due_ns = fw->busy_until_ns;
    return due_ns == UINT64_MAX ? UINT64_MAX : due_ns / NS_PER_US + 1;
}
