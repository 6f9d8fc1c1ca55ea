/* SPDX-License-Identifier: MIT */
/*
 * main.c - a robot on a bare Cortex-M4: no system, no sockets, no memory but what is declared.
 * UART 0 is the byte stream to the host (on a robot a serial radio; in QEMU a TCP connection),
 * UART 1 leads to an e-puck's microcontroller, which speaks GCtronic's advanced sercom.
 * The board is ARM's MPS2 with its AN386 image: `qemu-system-arm -M mps2-an386`.
 *
 * A stream does not say that it was connected anew. So a host that was silent for 2 s is greeted
 * again and again with a new nonce, and whatever it last sent in part is forgotten.
 */
#include <string.h>

#include "../../epuck_asercom.h"
#include "../robot.h"
#include "board.h"

#ifndef ROBOT_TAG
#define ROBOT_TAG 23
#endif
#define POLL_NS 50000000u    /* [ns] between two packets to the motors that say the same */
#define ANSWER_NS 200000000u /* [ns] an answer that is later than this is none */

/* Sixteen random bytes of this start: of the chip's generator where it has one. QEMU's loader
 * writes them. */
extern const uint8_t start_secret[VS_KEY_SIZE];

static struct robot robot;
static uint8_t packet[VS_DATAGRAM_MAX];
static uint32_t greetings;

struct motors {
    uint64_t asked_ns;
    uint8_t owed; /* [byte] of the answer that have not come yet */
    uint8_t answer[EPUCK_ASERCOM_REPLY_MAX];
    uint8_t len;
    int16_t left_steps_s; /* what the last packet said */
    int16_t right_steps_s;
};
static struct motors motors;

/* No two of a start are the same, and nobody without its secret can foretell one. */
static void greet(uint64_t now_ns)
{
    uint8_t nonce[VS_NONCE_SIZE];

    greetings++;
    vs_tag_make(start_secret, (const uint8_t *)&greetings, sizeof greetings, nonce);
    robot_connected(&robot, nonce, now_ns);
}

static void start_motors_over(uint64_t now_ns)
{
    (void)board_write(UART_MOTORS, epuck_asercom_resync, EPUCK_ASERCOM_RESYNC_LEN);
    motors.owed = 0;
    motors.len = 0;
    motors.asked_ns = now_ns;
}

/* The answer proves that the packet was understood. One that does not come, or makes no sense,
 * has the other end start over. */
static void read_motors(uint64_t now_ns)
{
    const struct epuck_asercom_mode *mode = &epuck_asercom_modes[EPUCK_ASERCOM_EXTENSION];
    struct epuck_asercom_sensors sensors;
    int byte;

    while ((byte = board_read(UART_MOTORS)) >= 0) {
        if (motors.owed == 0) /* what it says of itself after starting over */
            continue;
        motors.answer[motors.len++] = (uint8_t)byte;
        if (motors.len < motors.owed)
            continue;
        motors.owed = 0;
        motors.len = 0;
        if (epuck_asercom_get_reply(mode, motors.answer, &sensors) != 0)
            start_motors_over(now_ns);
        else
            robot.telemetry.battery_mv = epuck_asercom_battery_mv(sensors.battery, 0);
    }
    if (motors.owed > 0 && now_ns - motors.asked_ns > ANSWER_NS) {
        robot.telemetry.base_errors++;
        start_motors_over(now_ns);
    }
}

static void drive(uint64_t now_ns)
{
    const struct epuck_asercom_mode *mode = &epuck_asercom_modes[EPUCK_ASERCOM_EXTENSION];
    struct epuck_asercom_poll poll = {0, 0, 0, 0x1FF};
    uint8_t request[EPUCK_ASERCOM_REQUEST_MAX];

    robot_wheels(&robot, now_ns, &poll.left_steps_s, &poll.right_steps_s);
    if (motors.owed > 0 ||
        (now_ns - motors.asked_ns < POLL_NS && poll.left_steps_s == motors.left_steps_s &&
         poll.right_steps_s == motors.right_steps_s))
        return;
    motors.left_steps_s = poll.left_steps_s;
    motors.right_steps_s = poll.right_steps_s;
    poll.leds = poll.left_steps_s || poll.right_steps_s ? robot.telemetry.leds : 0;
    (void)board_write(UART_MOTORS, request, epuck_asercom_put_poll(mode, &poll, request));
    motors.owed = (uint8_t)epuck_asercom_reply_len(mode);
    motors.asked_ns = now_ns;
}

static void talk(uint64_t now_ns)
{
    int is_telemetry, byte;
    size_t len;

    while ((byte = board_read(UART_HOST)) >= 0) {
        uint8_t one = (uint8_t)byte;

        (void)robot_bytes(&robot, &one, 1, now_ns); /* a broken session is lost after 1 s */
    }
    if (robot_is_lost(&robot, now_ns))
        greet(now_ns);
    while ((len = robot_packet(&robot, packet, now_ns, &is_telemetry)) > 0)
        (void)board_write(UART_HOST, packet, len); /* one that has no room is lost, as in the air */
}

int main(void)
{
    static struct vs_session_config config;

    config.tag = ROBOT_TAG;
    config.cannot_home = 1;
    memcpy(&config.started, start_secret, sizeof config.started);
    config.uid[0] = ROBOT_TAG & 0xFF;
    config.uid[1] = ROBOT_TAG >> 8;
    strcpy(config.name, "bare");
    strcpy(config.controller, "wide curve");
    strcpy(config.version, "example");
    board_init();
    if (robot_init(&robot, &config) != VS_OK)
        return 1;
    greet(board_now_ns());
    start_motors_over(board_now_ns());
    for (;;) {
        uint64_t now_ns = board_now_ns();

        talk(now_ns);
        read_motors(now_ns);
        drive(now_ns);
        board_wait();
    }
}
