/* SPDX-License-Identifier: MIT */
#include "fw_argos.h"

/* Timer: argos3-epuck 66cb8d9 firmware/firmware/motor_led/advance_one_timer/e_motors.c:253-288. */
enum { TIMER_HZ = 10000, MOTOR_MAX_STEPS_S = 1000, RING_LED_MASK = 0xFF, RAB_ENABLED = 1 };

#define NS_PER_US 1000u

static void wait_for_host(struct fw_argos *fw, uint64_t now_us)
{
    fw->body.outputs.leds &= (uint16_t)~RING_LED_MASK;
    fw->state = FW_ARGOS_WAKE;
    fw->waiting_us = now_us;
}

/* The wake-up byte has come: it is seen when the light takes its next step. */
static void wake_up(struct fw_argos *fw)
{
    uint64_t now_us = fw->uart.lived_ns / NS_PER_US;
    uint64_t waited_us = now_us > fw->waiting_us ? now_us - fw->waiting_us : 0;

    fw->state = FW_ARGOS_CONFIG;
    fw->got = 0;
    fw_uart_keep_busy(&fw->uart, (uint32_t)(FW_ARGOS_BLINK_US - waited_us % FW_ARGOS_BLINK_US));
}

void fw_argos_init(struct fw_argos *fw)
{
    *fw = (struct fw_argos){0};
    fw_body_init(&fw->body, MOTOR_MAX_STEPS_S, TIMER_HZ, 0);
    fw_uart_init(&fw->uart, EPUCK_ARGOS_BYTE_NS);
    wait_for_host(fw, 0);
}

void fw_argos_reset(struct fw_argos *fw, uint64_t now_us)
{
    int i;

    fw_body_reset(&fw->body, now_us);
    fw_uart_reset(&fw->uart);
    fw->old = (struct epuck_argos_actuators){0};
    fw->got = 0;
    for (i = 0; i < EPUCK_ARGOS_CONFIG_LEN; i++)
        fw->config[i] = 0;
    wait_for_host(fw, now_us);
}

static void send_sensors(struct fw_argos *fw)
{
    const struct fw_inputs *inputs = &fw->body.inputs;
    struct epuck_argos_sensors sensors;
    uint8_t frame[EPUCK_ARGOS_SENSOR_LEN];
    int i;

    for (i = 0; i < 8; i++) {
        sensors.prox[i] = inputs->prox[i];
        sensors.light[i] = inputs->light[i];
    }
    for (i = 0; i < 3; i++) {
        sensors.acceleration[i] = inputs->acceleration[i];
        sensors.microphones[i] = inputs->microphones[i];
    }
    sensors.rab_received = fw->rab_hears && fw->config[RAB_ENABLED] != 0;
    sensors.battery_good = inputs->battery_mv >= FW_ARGOS_BATTERY_LOW_MV;
    epuck_argos_put_sensors(&sensors, frame);
    fw_uart_send(&fw->uart, frame, sizeof frame);
}

static void apply(struct fw_argos *fw)
{
    struct fw_body *body = &fw->body;
    uint64_t now_us = fw->uart.lived_ns / NS_PER_US;
    struct epuck_argos_actuators new;
    int32_t left = body->outputs.left_steps_s;
    int32_t right = body->outputs.right_steps_s;

    epuck_argos_get_actuators(fw->frame, &new);
    if (new.left_steps_s != fw->old.left_steps_s)
        left = new.left_steps_s;
    if (new.right_steps_s != fw->old.right_steps_s)
        right = new.right_steps_s;
    fw_body_drive(body, left, right, now_us);
    fw_body_feed(body, now_us);
    body->outputs.leds ^= (uint16_t)(new.leds ^ fw->old.leds);
    fw_body_apply(body, now_us);
    fw->old = new;
    fw->frames++;
    if (new.reset == EPUCK_ARGOS_RESET)
        wait_for_host(fw, now_us);
    else if (new.ircom_enable)
        fw_uart_keep_busy(&fw->uart, FW_ARGOS_IRCOM_US);
    else
        send_sensors(fw);
}

static void consume(struct fw_argos *fw, uint8_t byte)
{
    if (fw->state == FW_ARGOS_WAKE) {
        wake_up(fw);
        return;
    }
    if (fw->state == FW_ARGOS_CONFIG) {
        fw->config[fw->got] = byte;
        fw->got++;
        if (fw->got == EPUCK_ARGOS_CONFIG_LEN) {
            fw->state = FW_ARGOS_FRAME;
            fw->got = 0;
            send_sensors(fw);
        }
        return;
    }
    fw->frame[fw->got] = byte;
    fw->got++;
    if (fw->got < EPUCK_ARGOS_ACTUATOR_LEN)
        return;
    fw->got = 0;
    apply(fw);
}

size_t fw_argos_receive(struct fw_argos *fw, const uint8_t *buf, size_t len,
                        uint64_t now_us)
{
    return fw_line_put(&fw->uart.rx, buf, len, now_us * NS_PER_US);
}

/* A frame that repeats the speed must count as another one after the watchdog's stop. */
static void watch(struct fw_argos *fw, uint64_t now_us)
{
    if (!fw_body_watch(&fw->body, now_us))
        return;
    fw->old.left_steps_s = 0;
    fw->old.right_steps_s = 0;
}

int fw_argos_advance(struct fw_argos *fw, uint64_t now_us)
{
    uint64_t watchdog_us = fw_body_watchdog_due_us(&fw->body);
    uint64_t until_us = watchdog_us < now_us ? watchdog_us : now_us;
    enum fw_uart_event event;
    uint8_t byte;

    while ((event = fw_uart_step(&fw->uart, until_us, &byte)) != FW_UART_NONE) {
        if (event == FW_UART_IDLE && !fw->uart.sending && fw->state == FW_ARGOS_FRAME)
            send_sensors(fw);
        if (event == FW_UART_BYTE)
            consume(fw, byte);
        if (fw_body_take_change(&fw->body))
            return 1;
    }
    watch(fw, now_us);
    return fw_body_take_change(&fw->body);
}

size_t fw_argos_transmit(struct fw_argos *fw, uint8_t *buf, size_t cap,
                         uint64_t now_us)
{
    return fw_uart_transmitted(&fw->uart, buf, cap, now_us);
}

uint64_t fw_argos_due_us(const struct fw_argos *fw)
{
    uint64_t uart_us = fw_uart_due_us(&fw->uart);
    uint64_t watchdog_us = fw_body_watchdog_due_us(&fw->body);

    return uart_us < watchdog_us ? uart_us : watchdog_us;
}
