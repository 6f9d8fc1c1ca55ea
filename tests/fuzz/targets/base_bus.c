/* SPDX-License-Identifier: MIT */
/*
 * The daemon's bases on an I2C bus, gctronic and york, with all boards, against the firmware's own
 * code on a bus that does everything that goes wrong, or against devices that answer whatever they
 * like. Nothing takes longer than it may, readings are numbers in their ranges, and when faults end
 * the base is found, stands still and obeys.
 */
#include "../../c/robot_bus.h"
#include "../../../c_src/epuck_bytes.h"
#include "../../../robot/base_sensors.h"
#include "fuzz.h"

#define STEPS 40

static struct bus_world w;
static struct input *in;
static int is_quiet;

/* A device that knows no protocol. */
static int transfer_anything(void *context, uint8_t address, const uint8_t *out, size_t out_len,
                             uint8_t *got, size_t got_len)
{
    static const int results[] = {VS_OK, VS_OK, VS_OK, VS_OK, VS_ERR_SILENT, VS_ERR_IO,
                                  VS_ERR_HANGUP, VS_OK};
    int result = in->left == 0 ? VS_ERR_SILENT : results[take_u8(in) & 7];

    (void)context;
    (void)address;
    CHECK(out_len <= VS_I2C_OUT_MAX && got_len <= VS_I2C_IN_MAX && out_len + got_len > 0);
    CHECK(out_len == 0 || out != NULL);
    w.now_ns += result == VS_ERR_SILENT ? VS_I2C_TIMEOUT_NS - 1000 : 90000 * (out_len + got_len);
    if (result == VS_OK && got_len > 0)
        take_into(in, got, got_len);
    if (result == VS_OK && got_len == EPUCK_GCTRONIC_SENSOR_LEN && is_quiet)
        got[got_len - 1] = epuck_xor(got, got_len - 1);
    return result;
}

static void check_values(void)
{
    double values[VS_BASE_NUMBERS_MAX];
    int sensor;
    int count;
    int i;

    for (sensor = 0; sensor < VS_BASE_SENSORS; sensor++) {
        count = vs_base_values(&w.reading, sensor, w.reading.boards.heard_count - 3, values,
                               VS_BASE_NUMBERS_MAX);
        CHECK(count >= 0 && count <= VS_BASE_NUMBERS_MAX);
        for (i = 0; i < count; i++)
            CHECK(values[i] - values[i] == 0.0); /* neither infinite nor no number */
    }
    CHECK(!w.reading.boards.has[VS_BOARD_GROUND] ||
          (w.reading.boards.ground[0] >= 0 && w.reading.boards.ground[0] <= EPUCK_GROUND_MAX));
    CHECK(w.reading.boards.battery_mv <= 8188);
}

static void ask_boards(void)
{
    struct vs_board_request request;
    int board;

    memset(&request, 0, sizeof request);
    request.message.length = (uint8_t)(take_u8(in) & 1 ? w.base.boards.reading.rab_bytes : 0);
    take_into(in, request.message.data, sizeof request.message.data);
    take_into(in, request.rgb, sizeof request.rgb);
    for (board = 0; board < VS_BOARDS; board++) {
        uint64_t began_ns = w.now_ns;
        const char *news = NULL;

        vs_boards_ask(&w.base.boards, board, &request, w.now_ns, &news);
        CHECK(w.now_ns - began_ns <= VS_BOARD_TALKS * (uint64_t)VS_BOARD_READ_NS);
        vs_boards_take(&w.reading.boards, &w.base.boards.reading, board);
    }
    check_values();
}

static void disturb(void)
{
    struct epuck_rab_message message = {{1, 2, 3, 4}, (int16_t)take_u16(in), take_u16(in)};

    w.wires.faults.refuse = take_u8(in);
    w.wires.faults.flip_write = take_u8(in);
    w.wires.faults.flip_read = take_u8(in);
    switch (take_below(in, 4)) {
    case 0:
        fw_york_reset(&w.york, w.now_ns / 1000);
        fw_gctronic_reset(&w.gctronic, w.now_ns / 1000);
        break;
    case 1:
        w.wires.stuck = 1;
        w.stuck_until_ns = w.now_ns + (uint64_t)take_u8(in) * MS;
        break;
    default:
        fw_rab_hear(&w.rab, &message);
        w.adc.channels_mv[0] = take_u16(in);
        w.york.tear = take_u8(in);
    }
}

static int exchange(int16_t left, uint16_t leds)
{
    int err = bus_exchange(&w, left, (int16_t)-left, leds);

    CHECK(err == VS_OK || err == VS_ERR_BUSY || err == VS_ERR_SILENT || err == VS_ERR_GARBLED ||
          err == VS_ERR_IO || err == VS_ERR_HANGUP);
    if (err == VS_OK)
        check_values();
    return err;
}

static void step(void)
{
    switch (take_below(in, 8)) {
    case 0:
        (void)bus_recover(&w);
        break;
    case 1:
        disturb();
        break;
    case 2:
        bus_pass(&w, (uint64_t)take_u8(in) * 10 * MS);
        break;
    case 3:
        (void)w.base.ops->close(&w.base);
        break;
    case 4:
        ask_boards();
        break;
    default:
        (void)exchange((int16_t)take_u16(in), take_u8(in));
    }
}

/* The bus is whole again. */
static void check_end(const struct vs_base_ops *ops)
{
    int tries = 0;

    memset(&w.wires.faults, 0, sizeof w.wires.faults);
    w.wires.stuck = 0;
    w.york.tear = 0;
    bus_pass(&w, 1000 * MS);
    while (bus_recover(&w) != VS_OK)
        CHECK(++tries < 20);
    bus_pass(&w, 2 * MS);
    CHECK(bus_at_rest(&w));
    for (tries = 0; exchange(200, 5) != VS_OK; tries++)
        CHECK(tries < 3);
    bus_pass(&w, 2 * MS);
    CHECK(w.body->outputs.left_steps_s == 200 && w.body->outputs.right_steps_s == -200);
    CHECK(ops != &vs_base_york || (w.body->outputs.leds & 0xFF) == 5);
}

static void start(uint8_t how)
{
    const struct vs_base_ops *ops = how & 1 ? &vs_base_york : &vs_base_gctronic;
    int board;

    bus_begin(&w, ops, 1);
    if (ops == &vs_base_york && how & 2) {
        struct vs_base_config config = {ops, "/nowhere", {""}, 2, 115, 0.0867438559f, {1, 0}, ""};

        CHECK(ops->open(&w.base, &config) == VS_ERR_IO);
        w.york.is_epuck2 = 1;
    }
    w.base.bus.context = &w;
    w.base.bus.now_ns = bus_now;
    w.base.bus.transfer = how & 4 ? transfer_anything : bus_transfer;
    for (board = 0; board < VS_BOARDS; board++)
        bus_board(&w, board, how & 8 ? 2 : 4);
    w.rab.is_stock = how >> 3 & 1;
    w.base.boards.reading.rab_k_cm = 10.0f; /* the largest that may be set */
    w.reading.boards = w.base.boards.reading;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct input whole = {data, size};
    uint8_t how;
    int i;

    in = &whole;
    how = take_u8(in);
    is_quiet = how >> 4 & 1;
    start(how);
    for (i = 0; i < STEPS && in->left > 0; i++)
        step();
    if (!(how & 4))
        check_end(w.base.ops);
    return 0;
}
