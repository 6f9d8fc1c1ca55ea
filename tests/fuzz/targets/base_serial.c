/* SPDX-License-Identifier: MIT */
/*
 * The daemon's bases behind a serial line, argos and asercom, against the firmware's own code on
 * virtual time, or against a far end that sends whatever it likes. Nothing takes longer than it
 * may, readings lie in their ranges; without a fault on the line only speeds that were commanded
 * are ever driven; and when faults end the base is found, stands still and obeys.
 */
#include "../../../robot/base_config.h"
#include "../../../robot/base_sensors.h"
#include "../../../firmware_bridge/fw_argos.h"
#include "../../../firmware_bridge/fw_asercom.h"
#include "fuzz.h"

#define MS 1000000u
#define STEPS 40
#define UNIT 30 /* [step/s] commands are multiples of it */

extern const struct vs_base_ops vs_base_argos;
extern const struct vs_base_ops vs_base_asercom;

static struct world {
    struct fw_argos argos;
    struct fw_asercom asercom;
    struct vs_base base;
    struct vs_base_reading reading;
    struct input *in;
    uint64_t now_ns;
    uint8_t is_argos;
    uint8_t hostile; /* the far end is the input */
    uint8_t faulty;  /* something went wrong on the line */
    int8_t allowed[2]; /* in units: the newest command and the one before */
} w;

static struct fw_body *body(void)
{
    return w.is_argos ? &w.argos.body : &w.asercom.body;
}

/* The right wheel is told to turn the other way at half the left one's speed. */
static int is_commanded(void)
{
    const struct fw_outputs *out = &body()->outputs;
    int i;

    for (i = 0; i < 2; i++)
        if (out->left_steps_s == w.allowed[i] * UNIT &&
            out->right_steps_s == -w.allowed[i] * UNIT / 2)
            return 1;
    return out->left_steps_s == 0 && out->right_steps_s == 0;
}

static void live(void)
{
    uint64_t now_us = w.now_ns / 1000;

    while (w.is_argos ? fw_argos_advance(&w.argos, now_us)
                      : fw_asercom_advance(&w.asercom, now_us))
        CHECK(w.faulty || is_commanded());
}

static uint64_t io_now(void *context)
{
    (void)context;
    return w.now_ns;
}

/* What a far end that knows no protocol sends. */
static int read_anything(uint8_t *buf, size_t cap, uint64_t deadline_ns)
{
    size_t len = take_u8(w.in);
    uint64_t late_ns = take_u8(w.in) * (uint64_t)100000;

    if (w.in->left == 0 || len >= 250 || w.now_ns + late_ns > deadline_ns) {
        if (w.now_ns < deadline_ns)
            w.now_ns = deadline_ns;
        return len == 250 && w.in->left > 0 ? VS_ERR_IO : len == 251 ? VS_ERR_HANGUP : 0;
    }
    w.now_ns += late_ns;
    len = len < cap ? len : cap;
    take_into(w.in, buf, len);
    return (int)len;
}

static int io_read(void *context, uint8_t *buf, size_t cap, uint64_t deadline_ns)
{
    (void)context;
    if (w.hostile)
        return read_anything(buf, cap, deadline_ns);
    for (;;) {
        size_t len;

        live();
        len = w.is_argos ? fw_argos_transmit(&w.argos, buf, cap, w.now_ns / 1000)
                         : fw_asercom_transmit(&w.asercom, buf, cap, w.now_ns / 1000);
        if (len > 0 || w.now_ns >= deadline_ns)
            return (int)len;
        w.now_ns += 300000;
        if (w.now_ns > deadline_ns)
            w.now_ns = deadline_ns;
    }
}

static int io_write(void *context, const uint8_t *buf, size_t len, uint64_t deadline_ns)
{
    size_t taken;

    (void)context;
    (void)deadline_ns;
    if (w.hostile)
        return VS_OK;
    live();
    taken = w.is_argos ? fw_argos_receive(&w.argos, buf, len, w.now_ns / 1000)
                       : fw_asercom_receive(&w.asercom, buf, len, w.now_ns / 1000);
    CHECK(taken == len || w.faulty);
    live();
    return VS_OK;
}

static void start(uint8_t mode)
{
    const struct vs_base_ops *ops = w.is_argos ? &vs_base_argos : &vs_base_asercom;
    struct vs_base_config config = {ops, "/nowhere", {""}, 2, 115, 0.0867438559f, {0, 0}, ""};

    if (!w.is_argos) {
        config.choice[1] = mode >= EPUCK_ASERCOM_EPUCK2;
        config.choice[0] = (uint8_t)(config.choice[1]
                                         ? mode - EPUCK_ASERCOM_EPUCK2 + EPUCK_ASERCOM_BLUETOOTH
                                         : mode);
    }
    w.base.ops = ops;
    CHECK(ops->open(&w.base, &config) == VS_ERR_IO);
    w.base.io.now_ns = io_now;
    w.base.io.read = io_read;
    w.base.io.write = io_write;
    w.base.io.expect = NULL;
    fw_argos_init(&w.argos);
    fw_asercom_init(&w.asercom, mode);
}

static int is_fault_or_ok(int err)
{
    return err == VS_OK || err == VS_ERR_LATE || err == VS_ERR_BUSY || err == VS_ERR_SILENT ||
           err == VS_ERR_GARBLED || err == VS_ERR_IO || err == VS_ERR_HANGUP;
}

static void check_values(void)
{
    double values[VS_BASE_NUMBERS_MAX];
    int sensor;
    int count;
    int i;

    for (sensor = 0; sensor < VS_BASE_SENSORS; sensor++) {
        count = vs_base_values(&w.reading, sensor, 0, values, VS_BASE_NUMBERS_MAX);
        CHECK(count >= 0 && count <= VS_BASE_NUMBERS_MAX);
        for (i = 0; i < count; i++)
            CHECK(values[i] - values[i] == 0.0); /* neither infinite nor no number */
    }
    for (i = 0; i < 8; i++)
        CHECK(w.reading.light[i] >= -1 && w.reading.light[i] <= 4096);
}

static int exchange(int8_t units, uint16_t leds)
{
    struct vs_base_command command;
    uint64_t began_ns = w.now_ns;
    int err;

    memset(&command, 0, sizeof command);
    command.left_steps_s = (int16_t)(units * UNIT);
    command.right_steps_s = (int16_t)(-units * UNIT / 2);
    command.leds = leds;
    w.allowed[1] = w.allowed[0];
    w.allowed[0] = units;
    err = vs_base_exchange(&w.base, &command, &w.reading);
    CHECK(w.now_ns - began_ns <= 30 * MS);
    CHECK(is_fault_or_ok(err));
    if (err == VS_OK) {
        check_values();
        live();
        CHECK(w.hostile || w.faulty || body()->outputs.left_steps_s == command.left_steps_s);
    }
    return err;
}

static int recover(void)
{
    uint64_t began_ns = w.now_ns;
    int err = vs_base_recover(&w.base);

    CHECK(w.now_ns - began_ns <= 100 * MS);
    CHECK(is_fault_or_ok(err));
    return err;
}

static void disturb(void)
{
    struct fw_uart *uart = w.is_argos ? &w.argos.uart : &w.asercom.uart;
    struct fw_line_faults *faults;
    size_t len;
    const uint8_t *bytes;

    w.faulty = 1;
    switch (take_below(w.in, 4)) {
    case 0:
        if (w.is_argos)
            fw_argos_reset(&w.argos, w.now_ns / 1000);
        else
            fw_asercom_reset(&w.asercom, take_u8(w.in) & 1, w.now_ns / 1000);
        break;
    case 1:
        faults = take_u8(w.in) & 1 ? &uart->rx.faults : &uart->tx.faults;
        faults->lose = take_u8(w.in);
        faults->flip = take_u8(w.in);
        faults->twice = take_u8(w.in);
        break;
    default:
        len = take_u8(w.in);
        bytes = take_bytes(w.in, &len);
        (void)(w.is_argos ? fw_argos_receive(&w.argos, bytes, len, w.now_ns / 1000)
                          : fw_asercom_receive(&w.asercom, bytes, len, w.now_ns / 1000));
    }
}

static void step(void)
{
    switch (take_below(w.in, 8)) {
    case 0:
        (void)recover();
        break;
    case 1:
        disturb();
        break;
    case 2:
        w.now_ns += (uint64_t)take_u8(w.in) * MS;
        live();
        break;
    case 3:
        (void)w.base.ops->close(&w.base);
        break;
    default:
        (void)exchange((int8_t)(take_u8(w.in) % 67) - 33, take_u8(w.in));
    }
}

/* The line is whole again. A reset in the middle of recovery may leave it shifted, which shows
 * within a few exchanges. */
static void check_end(void)
{
    struct fw_uart *uart = w.is_argos ? &w.argos.uart : &w.asercom.uart;
    int lost = 1;
    int goods = 0;
    int tries = 0;

    memset(&uart->rx.faults, 0, sizeof uart->rx.faults);
    memset(&uart->tx.faults, 0, sizeof uart->tx.faults);
    w.now_ns += 1000 * (uint64_t)MS; /* a reset may come twice */
    live();
    while (goods < 6) {
        int err = lost ? recover() : exchange(10, 0x105);

        CHECK(++tries < 600);
        if (lost && err == VS_OK)
            CHECK(body()->outputs.left_steps_s == 0 && body()->outputs.right_steps_s == 0);
        goods = !lost && err == VS_OK ? goods + 1 : 0;
        lost = err != VS_OK && (lost || (err != VS_ERR_LATE && err != VS_ERR_BUSY));
    }
    CHECK(body()->outputs.left_steps_s == 10 * UNIT && body()->outputs.right_steps_s == -5 * UNIT);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct input in = {data, size};
    uint8_t how = take_u8(&in);
    int i;

    memset(&w, 0, sizeof w);
    w.in = &in;
    w.now_ns = 1000 * MS;
    w.is_argos = how & 1;
    w.hostile = how >> 1 & 1;
    w.faulty = how >> 2 & 1;
    start((uint8_t)((how >> 3) % EPUCK_ASERCOM_MODES));
    for (i = 0; i < STEPS && in.left > 0; i++)
        step();
    if (!w.hostile)
        check_end();
    return 0;
}
