/* SPDX-License-Identifier: MIT */
#include "fw_asercom.h"

#include "epuck_bytes.h"
#include "fw_asercom_answers.h"

enum {
    MOTOR_MAX_STEPS_S = 1000,
    TIMER_HZ = 10000, /* e-puck-library 4cb85cb library/motor_led/advance_one_timer/e_motors.c */
    BINARY = 0x80, /* codes begin here */
    RING_LEDS = 0xFF,
    ALL_LEDS = 0x3FF
};

#define NS_PER_US 1000u

static const char banner[] = "\f\aWELCOME to the SerCom protocol on e-Puck\r\n"
                             "the EPFL education robot type \"H\" for help\r\n";
static const char version[] = EPUCK_ASERCOM_VERSION
    " 1.2.2 August 2008 GCtronic\r\nHW version: 1\r\n";

static uint64_t now_us(const struct fw_asercom *fw)
{
    return fw->uart.lived_ns / NS_PER_US;
}

void fw_asercom_init(struct fw_asercom *fw, int mode)
{
    *fw = (struct fw_asercom){0};
    fw->mode = &epuck_asercom_modes[mode];
    fw->state = FW_ASERCOM_IDLE;
    fw->reset_us = FW_NEVER_US;
    fw_body_init(&fw->body, MOTOR_MAX_STEPS_S, TIMER_HZ, 0);
    fw_uart_init(&fw->uart, (uint32_t)(10000000000u / fw->mode->baud));
}

void fw_asercom_reset(struct fw_asercom *fw, int again, uint64_t at_us)
{
    fw_body_reset(&fw->body, at_us);
    fw_uart_reset(&fw->uart);
    fw->uart.lived_ns = at_us * NS_PER_US;
    fw_uart_keep_busy(&fw->uart, FW_ASERCOM_BOOT_US);
    fw->commanded[0] = fw->commanded[1] = 0;
    fw->state = FW_ASERCOM_BOOT;
    fw->reset_us = again ? at_us + FW_ASERCOM_BOOT_US + FW_ASERCOM_AGAIN_US : FW_NEVER_US;
}

static void say(struct fw_asercom *fw, const char *text)
{
    size_t len = 0;

    while (text[len] != '\0')
        len++;
    fw_uart_send(&fw->uart, (const uint8_t *)text, len);
}

static void drive(struct fw_asercom *fw)
{
    fw_body_drive(&fw->body, fw->commanded[0], fw->commanded[1], now_us(fw));
    fw_body_feed(&fw->body, now_us(fw));
    fw_body_apply(&fw->body, now_us(fw));
}

static void set_led(struct fw_asercom *fw, uint8_t number, uint8_t state)
{
    unsigned int which = number >= EPUCK_ASERCOM_LEDS ? RING_LEDS : 1u << number;
    uint16_t mask = (uint16_t)(which & fw->mode->leds);

    if (state == 0)
        fw->body.outputs.leds &= (uint16_t)~mask;
    else if (state == 1)
        fw->body.outputs.leds |= mask;
    else
        fw->body.outputs.leds ^= mask;
    fw_body_apply(&fw->body, now_us(fw));
}

static void act(struct fw_asercom *fw)
{
    if (fw->code == EPUCK_ASERCOM_SPEED) {
        fw->commanded[0] = epuck_get_s16(fw->payload);
        fw->commanded[1] = epuck_get_s16(fw->payload + 2);
        drive(fw);
    } else if (fw->code == EPUCK_ASERCOM_LED) {
        set_led(fw, fw->payload[0], fw->payload[1]);
    } else if (fw->code == FW_ASERCOM_SET_STEPS) {
        fw_body_set_steps(&fw->body, epuck_get_s16(fw->payload), epuck_get_s16(fw->payload + 2),
                          now_us(fw));
    }
}

static void take_code(struct fw_asercom *fw, uint8_t code)
{
    fw->code = code;
    fw->got = 0;
    fw->wanted = fw_asercom_payload(fw, code);
    fw->state = fw->wanted > 0 ? FW_ASERCOM_PAYLOAD : FW_ASERCOM_CODE;
    fw_asercom_answer(fw, code);
}

static void take_payload(struct fw_asercom *fw, uint8_t byte)
{
    if (fw->got < sizeof fw->payload)
        fw->payload[fw->got] = byte;
    if (++fw->got < fw->wanted)
        return;
    fw->state = FW_ASERCOM_CODE;
    act(fw);
}

static void end_packet(struct fw_asercom *fw)
{
    fw->state = FW_ASERCOM_IDLE;
    fw->packets++;
    if (fw->reply_len > 0)
        fw_uart_send(&fw->uart, fw->reply, fw->reply_len);
}

/* Reads ",l,r" as scanf does: what is missing leaves the old value. */
static void scan_speeds(struct fw_asercom *fw)
{
    const char *at = fw->line + 1;
    int side;

    for (side = 0; side < 2 && *at == ','; side++) {
        int negative = at[1] == '-';
        int32_t value = 0;

        at += 1 + negative;
        if (*at < '0' || *at > '9')
            return;
        for (; *at >= '0' && *at <= '9' && value < 100000; at++)
            value = 10 * value + (*at - '0');
        fw->commanded[side] = (int16_t)(negative ? -value : value);
    }
}

static int is_mute(const struct fw_asercom *fw, char letter)
{
    return fw_asercom_is_extension(fw) &&
           (letter == 'I' || letter == 'J' || letter == 'M' || letter == 'W' || letter == 'Y' ||
            letter == 'Z');
}

static int is_known(char letter)
{
    return letter == 'b' || letter == 'g' ||
           (letter >= 'A' && letter <= 'Z' && letter != 'G' && letter != 'X');
}

/* What a line says. Of most commands only the answer's first letter is emulated. */
static void obey(struct fw_asercom *fw)
{
    char letter = fw->line[0];
    char brief[] = "?\r\n";

    if (letter >= 'a' && letter <= 'z' && letter != 'b' && letter != 'g')
        letter = (char)(letter - 'a' + 'A');
    if (is_mute(fw, letter))
        return;
    if (letter == 'V' || !is_known(letter)) {
        say(fw, letter == 'V' ? version : "z,Command not found\r\n");
        return;
    }
    if (letter == 'D')
        scan_speeds(fw);
    if (letter == 'S')
        fw->commanded[0] = fw->commanded[1] = 0;
    if (letter == 'D' || letter == 'S')
        drive(fw);
    if (letter == 'S')
        set_led(fw, EPUCK_ASERCOM_LEDS, 0);
    brief[0] = (char)(letter >= 'A' && letter <= 'Z' ? letter - 'A' + 'a' : letter);
    say(fw, brief);
    if (letter == 'R')
        fw_asercom_reset(fw, 0, now_us(fw));
}

static void take_line(struct fw_asercom *fw, uint8_t byte)
{
    if (byte != '\r' && byte != '\n') {
        if (fw->got + 1 < FW_ASERCOM_LINE_MAX)
            fw->line[fw->got++] = (char)byte;
        return;
    }
    fw->line[fw->got] = '\0';
    fw->state = FW_ASERCOM_IDLE;
    obey(fw);
}

static void consume(struct fw_asercom *fw, uint8_t byte)
{
    switch (fw->state) {
    case FW_ASERCOM_CODE:
        if (byte == 0)
            end_packet(fw);
        else
            take_code(fw, byte);
        break;
    case FW_ASERCOM_PAYLOAD:
        take_payload(fw, byte);
        break;
    case FW_ASERCOM_LINE:
        take_line(fw, byte);
        break;
    default:
        fw->got = 0;
        fw->reply_len = 0;
        if (fw->state == FW_ASERCOM_IDLE && byte >= BINARY)
            take_code(fw, byte);
        else if (byte == '\r' || byte == '\n')
            fw->state = FW_ASERCOM_NEWLINE;
        else if (fw->state == FW_ASERCOM_NEWLINE || byte != 0) {
            fw->state = FW_ASERCOM_LINE;
            fw->line[fw->got++] = (char)byte;
        }
        break;
    }
}

size_t fw_asercom_receive(struct fw_asercom *fw, const uint8_t *buf, size_t len,
                          uint64_t at_us)
{
    return fw_line_put(&fw->uart.rx, buf, len, at_us * NS_PER_US);
}

static uint64_t earlier(uint64_t one_us, uint64_t other_us)
{
    return one_us < other_us ? one_us : other_us;
}

/* What happens by itself. Returns 1 if something did. */
static int live(struct fw_asercom *fw, uint64_t until_us)
{
    if (fw->reset_us <= until_us) {
        fw_asercom_reset(fw, 0, fw->reset_us);
        return 1;
    }
    if (!fw_body_watch(&fw->body, until_us))
        return 0;
    fw->commanded[0] = fw->commanded[1] = 0;
    return 1;
}

int fw_asercom_advance(struct fw_asercom *fw, uint64_t to_us)
{
    uint64_t own_us = earlier(fw->reset_us, fw_body_watchdog_due_us(&fw->body));
    uint64_t until_us = earlier(own_us, to_us);
    enum fw_uart_event event;
    uint8_t byte;

    fw->body.changed = 0;
    while ((event = fw_uart_step(&fw->uart, until_us, &byte)) != FW_UART_NONE) {
        if (event == FW_UART_BYTE)
            consume(fw, byte);
        else if (fw->state == FW_ASERCOM_BOOT) {
            fw->state = FW_ASERCOM_IDLE;
            say(fw, banner);
        }
        if (fw_body_take_change(&fw->body))
            return 1;
    }
    return live(fw, until_us);
}

size_t fw_asercom_transmit(struct fw_asercom *fw, uint8_t *buf, size_t cap,
                           uint64_t at_us)
{
    return fw_uart_transmitted(&fw->uart, buf, cap, at_us);
}

uint64_t fw_asercom_due_us(const struct fw_asercom *fw)
{
    return earlier(fw_uart_due_us(&fw->uart),
                   earlier(fw->reset_us, fw_body_watchdog_due_us(&fw->body)));
}
