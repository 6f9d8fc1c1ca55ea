/* SPDX-License-Identifier: MIT */
#include "fw_wifi.h"

enum {
    MOTOR_MAX_STEPS_S = 1100, /* e-puck2_main-processor 517ef07 src/motors.h:7 */
    TIMER_HZ = 50000,         /* as fw_gctronic.c has it: the same main processor */
    FULL_RAW = 4096,          /* as epuck_asercom_battery_mv reads them back */
    FULL_MV = 5000
};

void fw_wifi_init(struct fw_wifi *fw)
{
    *fw = (struct fw_wifi){.send_us = FW_NEVER_US};
    fw_body_init(&fw->body, MOTOR_MAX_STEPS_S, TIMER_HZ, 0);
}

void fw_wifi_connect(struct fw_wifi *fw)
{
    fw->got = 0;
    fw->send_us = FW_NEVER_US;
}

void fw_wifi_reset(struct fw_wifi *fw, uint64_t now_us)
{
    fw_body_reset(&fw->body, now_us);
    fw_wifi_connect(fw);
}

static void act(struct fw_wifi *fw)
{
    struct epuck_wifi_command command;
    int i;

    if (epuck_wifi_get_command(fw->command, &command) != 0)
        return;
    fw->packets++;
    fw->body.outputs.leds = command.leds;
    for (i = 0; i < 12; i++) {
        fw->body.outputs.rgb[i / 3][i % 3] = command.rgb[i / 3][i % 3];
        if (command.rgb[i / 3][i % 3] != 0)
            fw->body.outputs.leds |= (uint16_t)(2u << (2 * (i / 3)));
    }
    fw_body_drive(&fw->body, command.left_steps_s, command.right_steps_s, fw->lived_us);
    fw_body_feed(&fw->body, fw->lived_us);
    fw_body_apply(&fw->body, fw->lived_us);
    if ((command.asks & EPUCK_WIFI_STREAM_SENSORS) == 0)
        fw->send_us = FW_NEVER_US;
    else if (fw->send_us == FW_NEVER_US)
        fw->send_us = fw->lived_us;
}

size_t fw_wifi_receive(struct fw_wifi *fw, const uint8_t *buf, size_t len, uint64_t now_us)
{
    size_t i;

    fw->lived_us = now_us;
    for (i = 0; i < len; i++) {
        fw->command[fw->got++] = buf[i];
        if (fw->got < sizeof fw->command)
            continue;
        fw->got = 0;
        act(fw);
    }
    return len;
}

int fw_wifi_advance(struct fw_wifi *fw, uint64_t now_us)
{
    fw->lived_us = now_us;
    (void)fw_body_watch(&fw->body, now_us);
    return fw_body_take_change(&fw->body);
}

size_t fw_wifi_transmit(struct fw_wifi *fw, uint8_t *buf, size_t cap, uint64_t now_us)
{
    const struct fw_inputs *in = &fw->body.inputs;
    struct epuck_wifi_sensors sensors = {{0}, {0}, {0}, {0}, 0, {0}, {0}, 0, {0}};
    int i;

    if (now_us < fw->send_us || cap < 1 + EPUCK_WIFI_SENSORS_LEN)
        return 0;
    fw->send_us = now_us + FW_WIFI_PERIOD_US;
    for (i = 0; i < 8; i++) {
        sensors.prox[i] = in->prox[i];
        sensors.light[i] = in->light[i];
    }
    for (i = 0; i < 3; i++) {
        sensors.acceleration[i] = in->acceleration[i];
        sensors.rates[i] = in->rates[i];
        sensors.ground[i] = in->ground[i];
    }
    for (i = 0; i < 4; i++)
        sensors.microphones[i] = in->microphones[i];
    sensors.distance_mm = in->distance_mm;
    sensors.steps[0] = fw_body_steps(&fw->body, 0, now_us);
    sensors.steps[1] = fw_body_steps(&fw->body, 1, now_us);
    sensors.battery = (uint16_t)(in->battery_mv * FULL_RAW / FULL_MV);
    buf[0] = EPUCK_WIFI_SENSORS;
    epuck_wifi_put_sensors(&sensors, buf + 1);
    return 1 + EPUCK_WIFI_SENSORS_LEN;
}

uint64_t fw_wifi_due_us(const struct fw_wifi *fw)
{
    uint64_t due_us = fw_body_watchdog_due_us(&fw->body);

    return fw->send_us < due_us ? fw->send_us : due_us;
}
