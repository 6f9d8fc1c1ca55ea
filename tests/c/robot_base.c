/* SPDX-License-Identifier: MIT */
/*
 * The daemon's base_argos against the firmware's own code, over an in-memory line on
 * virtual time: it must find the microcontroller in any state, and no speed may ever
 * reach the motors that nobody commanded. argv[1]: how many random worlds.
 */
#include "robot_world.h"

/* [ns] from 'R' to the end of recovery: a silence that shows that it was taken, a step of the
 * blinking light, 72 bytes, and one more proof. */
#define CONFIGURE_NS (15 * MS + FW_ARGOS_BLINK_US * 1000u + 7 * MS + 25 * MS)

/* Recovers; returns how long it took [ns]. */
static uint64_t recover(struct world *w)
{
    static const uint8_t no_config[EPUCK_ARGOS_CONFIG_LEN];
    uint64_t began_ns = w->now_ns;
    int steps = 0;
    int err;

    while ((err = w->base.ops->recover(&w->base)) != VS_OK) {
        CHECK(err == VS_ERR_BUSY || err == VS_ERR_SILENT);
        steps++;
        CHECK(steps < 500);
    }
    CHECK(w->fw.body.outputs.left_steps_s == 0);
    CHECK(w->fw.body.outputs.right_steps_s == 0);
    CHECK(w->fw.state == FW_ARGOS_FRAME && w->fw.got == 0);
    CHECK(w->leds_lost || w->fw.body.outputs.leds == 0);
    CHECK(memcmp(w->fw.config, no_config, sizeof no_config) == 0);
    return w->now_ns - began_ns;
}

/* A command must arrive as it is. */
static void prove_aligned(struct world *w)
{
    struct vs_base_command command = {300, -200, 0x105, {0, {0}}, {{0}}};
    struct vs_base_reading reading;

    w->allowed[0] = command.left_steps_s;
    w->allowed[1] = command.right_steps_s;
    w->fw.body.inputs.prox[3] = 1234;
    w->fw.body.inputs.prox[4] = -7; /* flickering light */
    w->fw.body.inputs.light[5] = 96;
    w->fw.body.inputs.battery_mv = 3000;
    CHECK(w->base.ops->exchange(&w->base, &command, &reading) == VS_OK);
    CHECK(w->fw.body.outputs.left_steps_s == 300 && w->fw.body.outputs.right_steps_s == -200);
    CHECK(w->leds_lost || w->fw.body.outputs.leds == 0x105);
    CHECK(reading.prox[3] == 1234 && reading.prox[4] == 0);
    CHECK(reading.light[5] == 4000 && reading.battery_low == 1);
}

static void test_every_clean_state(void)
{
    static const uint8_t greeting[5];
    uint8_t frame[EPUCK_ARGOS_ACTUATOR_LEN];
    struct epuck_argos_actuators moving = {700, -600, 0x3FF, 0, 0};
    size_t greeted;
    size_t sent;

    epuck_argos_put_actuators(&moving, frame);
    for (greeted = 0; greeted <= 5; greeted++) {
        for (sent = 0; sent <= (greeted == 5 ? sizeof frame : 0); sent++) {
            struct world w;
            uint64_t began_ns;
            uint64_t took_ns;

            begin(&w, 1);
            feed(&w, greeting, greeted);
            pass(&w, 80 * MS); /* it blinks, then it answers */
            feed(&w, frame, sent);
            pass(&w, 20 * MS);
            watch(&w);
            began_ns = w.now_ns;
            took_ns = recover(&w);
            CHECK(w.reset_ns > began_ns && w.reset_ns - began_ns < 240 * MS);
            CHECK(took_ns < 240 * MS + CONFIGURE_NS);
            CHECK(w.fw.uart.overlapped == 0);
            prove_aligned(&w);
        }
    }
}

/* Random bytes that look like frames now and then, and 'R' more often than by chance. */
static size_t make_garbage(struct world *w, uint8_t *garbage, size_t cap)
{
    size_t len = draw(&w->random, (uint32_t)cap);
    size_t i;

    for (i = 0; i < len; i++) {
        garbage[i] = (uint8_t)draw(&w->random, 256);
        if (draw(&w->random, 4) == 0)
            garbage[i] = draw(&w->random, 2) ? 0 : EPUCK_ARGOS_RESET;
    }
    return len;
}

/* What zeros would make of the half frame that waits in the microcontroller. */
static void expect_first(const struct world *w, int16_t *left, int16_t *right)
{
    uint8_t frame[EPUCK_ARGOS_ACTUATOR_LEN] = {0};
    struct epuck_argos_actuators half;

    memcpy(frame, w->fw.frame, w->fw.state == FW_ARGOS_FRAME ? w->fw.got : 0);
    epuck_argos_get_actuators(frame, &half);
    *left = half.left_steps_s > 1000 ? 1000 : half.left_steps_s < -1000 ? -1000 : half.left_steps_s;
    *right = half.right_steps_s > 1000 ? 1000
           : half.right_steps_s < -1000 ? -1000 : half.right_steps_s;
}

/* The garbage has gone through: only its last, half frame is completed. */
static void test_after_garbage(uint32_t seed)
{
    uint8_t garbage[250];
    struct world w;
    int16_t left;
    int16_t right;

    begin(&w, seed);
    feed(&w, garbage, make_garbage(&w, garbage, sizeof garbage));
    pass(&w, 3000 * MS);
    expect_first(&w, &left, &right);
    watch(&w);
    recover(&w);
    CHECK(w.watched > 0 && w.first_left == left && w.first_right == right);
    prove_aligned(&w);
}

/* The garbage is still on the line, in the ring, or being answered. */
static void test_amid_garbage(uint32_t seed)
{
    uint8_t garbage[250];
    uint8_t scrap[512];
    struct world w;

    begin(&w, seed);
    feed(&w, garbage, make_garbage(&w, garbage, sizeof garbage));
    pass(&w, draw(&w.random, 40) * MS);
    if (draw(&w.random, 2))
        fw_argos_transmit(&w.fw, scrap, sizeof scrap, w.now_ns / 1000);
    recover(&w);
    watch(&w);
    prove_aligned(&w);
}

/* The far end sleeps now and then, far beyond every time-out: commands come late, but
 * no speed that was not commanded ever does. */
static void test_stalls(uint32_t seed)
{
    struct vs_base_command command = {0, 0, 0, {0, {0}}, {{0}}};
    struct vs_base_reading reading;
    struct world w;
    int lost = 1;
    int i;

    begin(&w, seed);
    w.stall_one_in = 10 + draw(&w.random, 60);
    watch(&w);
    w.allowed[0] = 555;
    w.allowed[1] = -444;
    for (i = 0; i < 60; i++) {
        int err;

        if (lost && w.base.ops->recover(&w.base) != VS_OK)
            continue;
        command.left_steps_s = draw(&w.random, 2) ? 555 : 0;
        command.right_steps_s = draw(&w.random, 2) ? -444 : 0;
        err = w.base.ops->exchange(&w.base, &command, &reading);
        lost = err != VS_OK && err != VS_ERR_LATE && err != VS_ERR_BUSY;
        CHECK(!lost || err == VS_ERR_SILENT || err == VS_ERR_GARBLED);
    }
    w.stall_one_in = 0;
    pass(&w, 200 * MS);
    recover(&w);
    watch(&w);
    prove_aligned(&w);
}

/* Bytes too many on the line shift every frame that follows, and nothing shows it: what
 * the wheels do then is nobody's wish, but a stop must stop them, however they are shifted. */
static void test_shifted_stop(uint32_t seed)
{
    struct vs_base_command command = {500, -400, 0x3FF, {0, {0}}, {{0}}};
    static const struct vs_base_command off;
    struct vs_base_reading reading;
    uint8_t noise[EPUCK_ARGOS_ACTUATOR_LEN];
    struct world w;
    int calls = 0;
    size_t i;
    int err;

    begin(&w, seed);
    recover(&w);
    CHECK(vs_base_exchange(&w.base, &command, &reading) == VS_OK);
    for (i = 0; i < sizeof noise; i++)
        noise[i] = (uint8_t)draw(&w.random, 256);
    feed(&w, noise, draw(&w.random, sizeof noise));
    pass(&w, 5 * MS);
    for (i = draw(&w.random, 3); i > 0; i--) {
        command.left_steps_s = (int16_t)(draw(&w.random, 2000) - 1000);
        if (vs_base_exchange(&w.base, &command, &reading) != VS_OK)
            return; /* noise that shows is no case for a stop */
    }
    while ((err = vs_base_exchange(&w.base, &off, &reading)) == VS_ERR_LATE)
        CHECK(++calls < 20);
    if (err != VS_OK)
        recover(&w);
    CHECK(w.fw.body.outputs.left_steps_s == 0 && w.fw.body.outputs.right_steps_s == 0);
}

/* While it drives, such a shift is found within a few exchanges, and mended. */
static void test_shift_is_found(uint32_t seed)
{
    struct vs_base_command command = {500, -400, 0x3FF, {0, {0}}, {{0}}};
    struct vs_base_reading reading;
    uint8_t noise[EPUCK_ARGOS_ACTUATOR_LEN];
    struct world w;
    int calls = 0;
    int err;
    size_t i;

    begin(&w, seed);
    recover(&w);
    CHECK(vs_base_exchange(&w.base, &command, &reading) == VS_OK);
    for (i = 0; i < sizeof noise; i++)
        noise[i] = (uint8_t)draw(&w.random, 256);
    feed(&w, noise, 1 + draw(&w.random, sizeof noise - 1));
    pass(&w, 5 * MS);
    do {
        err = vs_base_exchange(&w.base, &command, &reading);
        pass(&w, 40 * MS);
        CHECK(++calls < 12);
    } while (err == VS_OK || err == VS_ERR_LATE || err == VS_ERR_BUSY);
    recover(&w);
    prove_aligned(&w);
}

/* A burst that lost bytes, or is that of a shifted stream, is no reading; but for shifts
 * that put 0 and 1 where they are expected, and whole values of one sensor on another. */
static void test_shifted_bursts(void)
{
    struct epuck_argos_sensors sensors = {{12, 1, 300, 4096, 77, 5, 256, 900},
                                          {3900, 3000, 2048, 1, 4096, 10, 512, 3333},
                                          0, {0}, {0}, 0};
    uint8_t stream[3 * EPUCK_ARGOS_SENSOR_LEN];
    struct epuck_argos_sensors read;
    size_t shift;

    for (shift = 0; shift < 3; shift++)
        epuck_argos_put_sensors(&sensors, stream + shift * EPUCK_ARGOS_SENSOR_LEN);
    CHECK(epuck_argos_get_sensors(stream, &read) == 0);
    for (shift = 1; shift < EPUCK_ARGOS_SENSOR_LEN; shift++)
        CHECK(epuck_argos_get_sensors(stream + shift, &read) == -1 || read.rab_received != 0 ||
              shift == 22 || shift == 40);
}

/* Clean end, then the next daemon: no LED is left inverted. */
static void test_hand_back(void)
{
    struct world w;

    begin(&w, 7);
    recover(&w);
    prove_aligned(&w);
    CHECK(w.base.ops->close(&w.base) == VS_OK);
    pass(&w, 20 * MS);
    CHECK(w.fw.state == FW_ARGOS_WAKE);
    CHECK(w.fw.body.outputs.left_steps_s == 0 && w.fw.body.outputs.right_steps_s == 0);
    CHECK(w.fw.body.outputs.leds == 0);
    watch(&w);
    recover(&w);
    prove_aligned(&w);
    CHECK(w.fw.uart.overlapped == 0);
}

/* It is reset while it drives, and takes our next frame for wake-up and configuration: the
 * low byte of the right speed switches on its own range-and-bearing. The four zeros
 * of recovery's configuration switch it off. Source: argos3-epuck 66cb8d9,
 * firmware/firmware/firmware/epuck_firmware.c:86-117, 146-159, 279-315; the fields of the
 * configuration: firmware/firmware/real_epuck_base.h:43-47. */
static void test_reset_in_mid_run(uint32_t seed)
{
    struct vs_base_command command = {700, 600, 0, {0, {0}}, {{0}}};
    struct vs_base_reading reading;
    struct world w;
    int lost = 0;
    int goods = 0;
    int i;

    begin(&w, seed);
    w.fw.rab_hears = (uint8_t)draw(&w.random, 2);
    recover(&w);
    CHECK(vs_base_exchange(&w.base, &command, &reading) == VS_OK);
    fw_argos_reset(&w.fw, w.now_ns / 1000);
    pass(&w, draw(&w.random, 90) * MS);
    for (i = 0; i < 60 && goods < 12; i++) {
        int err;

        pass(&w, draw(&w.random, 50) * MS);
        if (lost) {
            recover(&w);
            lost = 0;
        }
        err = vs_base_exchange(&w.base, &command, &reading);
        lost = err != VS_OK && err != VS_ERR_LATE && err != VS_ERR_BUSY;
        goods = err == VS_OK ? goods + 1 : 0;
    }
    CHECK(goods == 12 && w.fw.config[1] == 0);
    CHECK(w.fw.body.outputs.left_steps_s == 700 && w.fw.body.outputs.right_steps_s == 600);
}

/* A microcontroller that is switched off: every call ends, and says so. */
static void test_silence(void)
{
    static const struct vs_base_command off;
    struct vs_base_reading reading;
    struct world w;
    uint64_t began_ns;
    int err = VS_ERR_BUSY;

    begin(&w, 3);
    w.stalled_until_ns = UINT64_MAX;
    began_ns = w.now_ns;
    CHECK(w.base.ops->exchange(&w.base, &off, &reading) == VS_ERR_SILENT);
    while (err == VS_ERR_BUSY) {
        uint64_t step_ns = w.now_ns;

        err = w.base.ops->recover(&w.base);
        CHECK(w.now_ns - step_ns <= 100 * MS);
    }
    CHECK(err == VS_ERR_SILENT);
    CHECK(w.waiting_len == EPUCK_ARGOS_ACTUATOR_LEN);
    CHECK(w.now_ns - began_ns < 300 * MS);
}

/* An answer that comes just before the end of the next exchange leaves no time to hold a byte
 * back: whichever frame's turn that is, no exchange takes longer than it may. */
static void test_late_answers(uint32_t rounds, uint64_t late_ns)
{
    struct vs_base_command command = {500, -400, 0, {0, {0}}, {{0}}};
    struct vs_base_reading reading;
    struct world w;
    int i;

    begin(&w, rounds + 1);
    recover(&w);
    for (; rounds > 0; rounds--)
        CHECK(vs_base_exchange(&w.base, &command, &reading) == VS_OK);
    w.stalled_until_ns = w.now_ns + late_ns;
    for (i = 0; i < 3; i++) {
        uint64_t began_ns = w.now_ns;

        (void)vs_base_exchange(&w.base, &command, &reading);
        CHECK(w.now_ns - began_ns <= VS_BASE_EXCHANGE_NS);
    }
}

int main(int argc, char *argv[])
{
    uint32_t worlds = argc > 1 ? (uint32_t)strtoul(argv[1], NULL, 10) : 1000;
    uint64_t late_ns;
    uint32_t seed;

    test_every_clean_state();
    test_hand_back();
    test_silence();
    test_shifted_bursts();
    for (late_ns = 0; late_ns < 60 * MS; late_ns += MS / 2)
        for (seed = 0; seed < 6; seed++)
            test_late_answers(seed, late_ns);
    for (seed = 1; seed <= worlds; seed++) {
        test_after_garbage(seed);
        test_amid_garbage(seed);
        test_stalls(seed);
        test_shifted_stop(seed);
        test_shift_is_found(seed);
        test_reset_in_mid_run(seed);
    }
    return 0;
}
