/* SPDX-License-Identifier: MIT */
/*
 * The daemon's base_gctronic and base_york against the firmware's own code, on an emulated
 * bus on virtual time: an exchange that says VS_OK was obeyed, whatever went wrong before,
 * and nothing takes longer than it may. argv[1]: how many random worlds.
 */
#include "robot_bus.h"

#define WHOLE_LEDS 0xA5

/* Packets with a bad checksum that a command of base_gctronic survives: nothing tells that
 * one came to the e-puck, so it is sent once, and twice if it stops wheels. */
#define CHANCES(left) ((left) == 0 ? 2u : 1u)

static const struct vs_base_ops *const kinds[] = {&vs_base_gctronic, &vs_base_york};

/* York's map on an e-puck2. */
static void begin_york_on_epuck2(struct bus_world *w, uint32_t seed)
{
    struct vs_base_config config = {&vs_base_york, "/nowhere", {"", ""}, 4, 115, 0.0867438559f, {1, 0}, ""};

    bus_begin(w, &vs_base_york, seed);
    CHECK(vs_base_york.open(&w->base, &config) == VS_ERR_IO);
    w->york.is_epuck2 = 1;
}

static void find(struct bus_world *w)
{
    int steps = 0;

    while (bus_recover(w) != VS_OK)
        CHECK(++steps < 20);
    CHECK(bus_at_rest(w));
}

/* An exchange with many writes may need a second call. */
static int complete(struct bus_world *w, int16_t left, int16_t right, uint16_t leds)
{
    int err = bus_exchange(w, left, right, leds);

    return err == VS_ERR_BUSY ? bus_exchange(w, left, right, leds) : err;
}

static void check_obeyed(struct bus_world *w, int16_t left, int16_t right)
{
    const struct fw_inputs *inputs = &w->body->inputs;
    int i;

    bus_pass(w, 2 * MS); /* of York's main loop */
    CHECK(w->body->outputs.left_steps_s == left && w->body->outputs.right_steps_s == right);
    for (i = 0; i < 8; i++) {
        CHECK(w->reading.prox[i] == inputs->prox[i]);
        CHECK(w->reading.light[i] == 4095 - inputs->light[i]);
    }
}

/* 0..255 become per cent, as the firmware takes them; what shines at all is never off. */
static void test_colours_reach_the_robot(void)
{
    static const uint8_t expected[4][3] = {{100, 0, 1}, {51, 100, 0}, {0, 0, 0}, {0, 0, 100}};
    struct vs_base_command command = {
        0, 0, 0, {0, {0}}, {{255, 0, 1}, {128, 255, 0}, {0, 0, 0}, {0, 0, 254}}};
    struct bus_world w;

    bus_begin(&w, &vs_base_gctronic, 9);
    find(&w);
    CHECK(vs_base_exchange(&w.base, &command, &w.reading) == VS_OK);
    bus_pass(&w, 2 * MS);
    CHECK(memcmp(w.body->outputs.rgb, expected, sizeof expected) == 0);
    CHECK(w.body->outputs.leds == (0x02 | 0x08 | 0x80));
    find(&w);
    CHECK(w.body->outputs.leds == 0);
}

static void test_plain_exchange(const struct vs_base_ops *ops)
{
    int16_t top = ops == &vs_base_york ? 1000 : 1100;
    struct bus_world w;
    int32_t way;

    bus_begin(&w, ops, 1);
    find(&w);
    CHECK(w.base.news == NULL);
    CHECK(complete(&w, 300, -200, WHOLE_LEDS | 0x200) == VS_OK);
    check_obeyed(&w, 300, -200);
    CHECK((w.body->outputs.leds & 0xFF) == WHOLE_LEDS);
    CHECK((w.body->outputs.leds & 0x200) == (ops == &vs_base_york ? 0x200 : 0));
    CHECK(w.reading.has_steps && !w.reading.blind && w.reading.step_nm > 125000);
    way = w.reading.steps[1];
    bus_pass(&w, 1000 * MS);
    CHECK(complete(&w, 300, -200, 0) == VS_OK);
    CHECK(way - w.reading.steps[1] >= 200 && way - w.reading.steps[1] < 210);
    CHECK(complete(&w, 32767, -32768, 0) == VS_OK);
    check_obeyed(&w, top, (int16_t)-top);
    CHECK(w.base.ops->close(&w.base) == VS_OK);
    bus_pass(&w, 2 * MS);
    CHECK(bus_at_rest(&w) && w.body->outputs.leds == 0);
}

/* It drives, stops and drives while things go wrong. */
static void test_faults(const struct vs_base_ops *ops, int is_epuck2, uint32_t seed)
{
    struct bus_world w;
    int lost = 1;
    int goods = 0;
    int i;

    if (is_epuck2)
        begin_york_on_epuck2(&w, seed);
    else
        bus_begin(&w, ops, seed);
    w.fault_one_in = 5 + draw(&w.random, 300);
    for (i = 0; i < 60; i++) {
        int16_t left = (int16_t)(i % 3 == 0 ? 0 : 10 * i + 3);
        uint32_t dropped = w.gctronic.dropped;
        int err;

        if (i == 40)
            w.fault_one_in = 0;
        if (lost && bus_recover(&w) != VS_OK)
            continue;
        err = bus_exchange(&w, left, (int16_t)-left, WHOLE_LEDS);
        CHECK(err == VS_OK || err == VS_ERR_BUSY || err == VS_ERR_SILENT || err == VS_ERR_GARBLED);
        lost = err != VS_OK && err != VS_ERR_BUSY;
        goods += err == VS_OK && i >= 40;
        if (err == VS_OK && w.gctronic.dropped - dropped < CHANCES(left)) {
            bus_pass(&w, 2 * MS);
            CHECK(w.body->outputs.left_steps_s == left);
            CHECK(w.body->outputs.right_steps_s == -left);
            CHECK(ops != &vs_base_york || (w.body->outputs.leds & 0xFF) == WHOLE_LEDS);
        }
        bus_pass(&w, draw(&w.random, 30) * MS);
    }
    CHECK(goods >= 12);
    CHECK((w.body->outputs.leds & 0xFF) == WHOLE_LEDS);
}

/* A stuck bus costs one time-out per call, and is found again when it is free. */
static void test_stuck(const struct vs_base_ops *ops)
{
    struct bus_world w;
    int calls = 0;

    bus_begin(&w, ops, 2);
    find(&w);
    CHECK(bus_exchange(&w, 500, 500, 0) == VS_OK);
    w.wires.stuck = 1;
    while (bus_exchange(&w, 0, 0, 0) == VS_ERR_BUSY)
        calls++;
    CHECK(calls == 2);
    CHECK(bus_recover(&w) == VS_ERR_SILENT);
    CHECK(bus_exchange(&w, 0, 0, 0) == VS_ERR_SILENT);
    w.wires.stuck = 0;
    find(&w);
}

/* What is there before the first packet, and what a bus that is stuck low says, is no answer. */
static void test_zeros_are_no_answer(void)
{
    uint8_t zeros[EPUCK_GCTRONIC_SENSOR_LEN] = {0};
    struct epuck_gctronic_sensors sensors;

    CHECK(epuck_gctronic_get_sensors(zeros, &sensors) == -1);
    memset(zeros, 0xFF, sizeof zeros);
    CHECK(epuck_gctronic_get_sensors(zeros, &sensors) == -1);
}

/* After an error on the bus the next packet is dropped, which no answer tells. */
static void test_resends_after_an_error(void)
{
    struct bus_world w;

    bus_begin(&w, &vs_base_gctronic, 3);
    find(&w);
    CHECK(bus_exchange(&w, 100, 100, 0) == VS_OK);
    w.wires.faults.refuse = 1;
    CHECK(bus_exchange(&w, 200, 200, 0) == VS_OK);
    bus_pass(&w, MS);
    CHECK(w.gctronic.dropped == 1 && w.body->outputs.left_steps_s == 200);
    w.gctronic.had_error = 1; /* it noted one that the host has not seen */
    CHECK(bus_exchange(&w, 0, 200, 0) == VS_OK);
    bus_pass(&w, MS);
    CHECK(w.gctronic.dropped == 2 && w.body->outputs.left_steps_s == 0);
}

/* Reset at any moment, and once more, as at power on. */
static void test_reset(const struct vs_base_ops *ops, uint32_t seed)
{
    struct bus_world w;
    int lost = 1;
    int goods = 0;
    int i;

    bus_begin(&w, ops, seed);
    for (i = 0; i < 200; i++) {
        int err;

        if (i == 20 || i == 22) {
            fw_york_reset(&w.york, w.now_ns / 1000);
            fw_gctronic_reset(&w.gctronic, w.now_ns / 1000);
        }
        bus_pass(&w, draw(&w.random, 20) * MS);
        if (lost && bus_recover(&w) != VS_OK)
            continue;
        err = bus_exchange(&w, 400, 400, 1);
        lost = err != VS_OK && err != VS_ERR_BUSY;
        goods = err == VS_OK ? goods + 1 : 0;
    }
    CHECK(goods > 5);
    check_obeyed(&w, 400, 400);
}

/* A reset that nobody saw on the bus: York's switch of the IR sensors is off again. */
static void test_reset_between_exchanges(void)
{
    struct bus_world w;
    int i;

    bus_begin(&w, &vs_base_york, 8);
    find(&w);
    CHECK(bus_exchange(&w, 0, 0, 0) == VS_OK);
    fw_york_reset(&w.york, w.now_ns / 1000);
    bus_pass(&w, 200 * MS);
    for (i = 0; i < 3 && bus_exchange(&w, 0, 0, 0) == VS_OK; i++)
        ;
    CHECK(i < 3 && w.base.news != NULL);
    find(&w);
    CHECK(w.york.registers[EPUCK_YORK_SENSING] == 1);
}

/* An e-puck2 with York's map: every LED may be lit, light is brightness as on an e-puck
 * (check_obeyed), its limit is that of the registers, and it has no switch for its sensors. */
static void test_york_on_an_epuck2(void)
{
    struct bus_world w;
    int i;

    begin_york_on_epuck2(&w, 11);
    find(&w);
    for (i = 0; i < 20; i++) {
        CHECK(complete(&w, 100, 100, (uint16_t)(0x3FF >> i / 2)) == VS_OK);
        check_obeyed(&w, 100, 100);
        CHECK(w.body->outputs.leds == 0x3FF >> i / 2);
    }
    CHECK(w.reading.step_nm == vs_body_epuck2.step_nm);
    CHECK(complete(&w, 1100, -1100, 0) == VS_OK);
    check_obeyed(&w, 1000, -1000);
    CHECK(w.base.ops->close(&w.base) == VS_OK && bus_at_rest(&w));
}

/* After an error on the bus what is written next is not applied, but read back as if it were.
 * Source: e-puck2_main-processor fcb74b1 src/gumstix.c:83-99, 159-170, 408-414. */
static void test_york_on_an_epuck2_after_an_error(void)
{
    struct bus_world w;
    uint32_t at;

    for (at = 1; at <= 16; at++) {
        begin_york_on_epuck2(&w, 14);
        find(&w);
        CHECK(complete(&w, 300, 300, 1) == VS_OK);
        w.wires.faults.refuse = at;
        CHECK(complete(&w, 0, 0, 2) == VS_OK);
        CHECK(bus_at_rest(&w) && w.body->outputs.leds == 2);
        w.york.had_error = 1; /* it noted one that the host has not seen */
        CHECK(complete(&w, 200, 0, 2) == VS_OK);
        CHECK(w.body->outputs.left_steps_s == 200 && w.york.dropped > 0);
    }
}

/* Flickering light may make proximity negative: that is nothing near, and no damage.
 * Source: pi-puck-e-puck1 0041716 pi-puck-e-puck1.X: ir_sensors.c:44,175 (a difference of two
 * readings of 0..4095, not clamped), main.c:96-103 (sent as it is). */
static void test_york_negative_proximity(void)
{
    struct bus_world w;
    int i;

    bus_begin(&w, &vs_base_york, 15);
    w.body->inputs.prox[3] = -4;
    w.body->inputs.prox[4] = -4095;
    w.body->inputs.prox[6] = 4095;
    find(&w);
    for (i = 0; i < 5; i++)
        CHECK(bus_exchange(&w, 0, 0, 0) == VS_OK);
    CHECK(w.reading.prox[6] == 4095);
    CHECK(w.reading.prox[3] == 0 && w.reading.prox[4] == 0 && w.reading.prox[5] == 507);
    w.body->inputs.prox[3] = -4096; /* no converter of 12 bits says that */
    CHECK(bus_exchange(&w, 0, 0, 0) == VS_ERR_BUSY);
}

/* A calibrated proximity is what was measured minus what was measured where nothing was near,
 * which may be negative. Source: e-puck2_main-processor 517ef07 src/sensors/proximity.c:191-193
 * (a difference of two readings), 346-358. */
static void test_gctronic_proximity_above_the_converter(void)
{
    struct bus_world w;

    bus_begin(&w, &vs_base_gctronic, 16);
    w.body->inputs.prox[2] = 4100;
    w.body->inputs.prox[6] = 8190;
    find(&w);
    CHECK(bus_exchange(&w, 0, 0, 0) == VS_OK);
    CHECK(w.reading.prox[2] == 4095 && w.reading.prox[6] == 4095 && w.gctronic.packets == 3);
    w.body->inputs.prox[6] = 8191;
    CHECK(bus_exchange(&w, 0, 0, 0) != VS_OK);
}

/* The first reading after a reset has every sensor's light: what was not measured yet is 4095.
 * Source: pi-puck-e-puck1 0041716 pi-puck-e-puck1.X: ir_sensors.c:9, 155-161, main.c:105. */
static void test_york_first_light_is_measured(void)
{
    struct bus_world w;
    int i;

    bus_begin(&w, &vs_base_york, 18);
    find(&w);
    CHECK(bus_exchange(&w, 0, 0, 0) == VS_OK);
    for (i = 0; i < 8; i++) {
        CHECK(w.reading.light[i] == 4095 - w.body->inputs.light[i]);
        CHECK(w.reading.prox[i] == w.body->inputs.prox[i]);
    }
}

static void test_gctronic_microphones(void)
{
    struct bus_world w;

    bus_begin(&w, &vs_base_gctronic, 17);
    w.body->inputs.microphones[0] = 700;
    w.body->inputs.microphones[3] = -1; /* 65535 on the bus */
    find(&w);
    CHECK(bus_exchange(&w, 0, 0, 0) == VS_OK && w.reading.microphone_count == 4);
    CHECK(w.reading.microphones[0] == 700 && w.reading.microphones[3] == INT16_MAX);
}

/* The bus of York's map is so slow that an exchange goes on with the next call; it must
 * end all the same, and never hang the bus by reading or writing too much. */
static void test_slow_host(void)
{
    struct bus_world w;
    int calls = 0;
    int i;

    bus_begin(&w, &vs_base_york, 9);
    w.overhead_us = 1500;
    find(&w);
    for (i = 0; i < 10; i++) {
        for (calls = 1; bus_exchange(&w, (int16_t)(10 * i), 50, (uint16_t)i) == VS_ERR_BUSY;
             calls++)
            CHECK(calls < 6);
        check_obeyed(&w, (int16_t)(10 * i), 50);
    }
    CHECK(calls > 1 && !w.wires.stuck && w.wires.failed == 0);
}

/* Counters that wrap are counted on, and a torn one is read again. */
static void test_counters(const struct vs_base_ops *ops)
{
    struct bus_world w;
    int i;

    bus_begin(&w, ops, 10);
    fw_body_set_steps(w.body, -200, 32700, w.now_ns / 1000);
    find(&w);
    for (i = 0; i < 40; i++) {
        CHECK(bus_exchange(&w, 1000, -1000, 0) == VS_OK);
        bus_pass(&w, 90 * MS);
    }
    CHECK(w.reading.steps[0] > 3600 && w.reading.steps[0] < 4100);
    CHECK(w.reading.steps[1] < -3600 && w.reading.steps[1] > -4100);
}

/* A counter that was read while its low byte carried would be a jump of two wheel turns. */
static void test_torn_counters(void)
{
    struct bus_world w;
    int32_t before[2];
    uint32_t at;

    bus_begin(&w, &vs_base_york, 12);
    find(&w);
    CHECK(bus_exchange(&w, 500, -500, 0) == VS_OK);
    for (at = 1; at <= 8; at++) {
        memcpy(before, w.reading.steps, sizeof before);
        w.york.tear = at;
        bus_pass(&w, 40 * MS);
        CHECK(bus_exchange(&w, 500, -500, 0) == VS_OK);
        CHECK(w.reading.steps[0] - before[0] > 0 && w.reading.steps[0] - before[0] < 60);
        CHECK(before[1] - w.reading.steps[1] > 0 && before[1] - w.reading.steps[1] < 60);
    }
}

/* No robot is told to be faster than its body can. */
static void test_speed_limit(const struct vs_base_ops *ops)
{
    static const struct vs_base_body slow = {400, 1};
    struct bus_world w;

    bus_begin(&w, ops, 13);
    find(&w);
    w.base.body = &slow;
    CHECK(bus_exchange(&w, 900, -900, 0) == VS_OK);
    check_obeyed(&w, 400, -400);
}

int main(int argc, char *argv[])
{
    uint32_t worlds = argc > 1 ? (uint32_t)strtoul(argv[1], NULL, 10) : 1000;
    uint32_t seed;
    size_t i;

    test_zeros_are_no_answer();
    test_resends_after_an_error();
    test_reset_between_exchanges();
    test_york_on_an_epuck2();
    test_york_on_an_epuck2_after_an_error();
    test_york_negative_proximity();
    test_gctronic_proximity_above_the_converter();
    test_york_first_light_is_measured();
    test_gctronic_microphones();
    test_colours_reach_the_robot();
    test_slow_host();
    test_torn_counters();
    for (i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        test_plain_exchange(kinds[i]);
        test_stuck(kinds[i]);
        test_counters(kinds[i]);
        test_speed_limit(kinds[i]);
        for (seed = 1; seed <= worlds; seed++) {
            test_faults(kinds[i], 0, seed);
            test_reset(kinds[i], seed);
        }
    }
    for (seed = 1; seed <= worlds; seed++)
        test_faults(&vs_base_york, 1, seed);
    return 0;
}
