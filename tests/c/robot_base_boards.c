/* SPDX-License-Identifier: MIT */
/*
 * The boards beside a base, on its bus: what the ground sensors say, every message heard
 * once and in order, every message said, and nothing of it at the base's cost.
 */
#include "robot_bus.h"

#define PI_E4 31416

static struct vs_base_command still; /* whose message goes out */

/* What the boards' processes do between two requests, one after the other here. */
static void serve_boards(struct bus_world *w)
{
    struct vs_boards *boards = &w->base.boards;
    uint64_t began_ns = w->now_ns;
    int more = 1;

    vs_boards_read_ground(boards, w->now_ns + VS_BOARD_READ_NS, &w->base.news);
    CHECK(w->now_ns - began_ns <= VS_BOARD_READ_NS);
    while (more) {
        began_ns = w->now_ns;
        more = vs_boards_talk(boards, &still.message, w->now_ns + VS_BOARD_TALK_NS, &w->base.news);
        CHECK(w->now_ns - began_ns <= VS_BOARD_TALK_NS);
        CHECK(w->fault_one_in != 0 || w->now_ns - began_ns <= 5 * MS);
    }
    vs_boards_take(&w->reading.boards, &boards->reading, VS_BOARD_GROUND);
    vs_boards_take(&w->reading.boards, &boards->reading, VS_BOARD_RAB);
}

static int exchange(struct bus_world *w)
{
    uint64_t began_ns = w->now_ns;
    int err = vs_base_exchange(&w->base, &still, &w->reading);

    CHECK(w->now_ns - began_ns <= 30 * MS);
    if (err == VS_OK)
        serve_boards(w);
    if (w->now_ns < began_ns + 50 * MS)
        bus_pass(w, began_ns + 50 * MS - w->now_ns);
    return err;
}

static void start(struct bus_world *w, uint8_t rab_bytes, uint32_t seed)
{
    int i;

    memset(&still, 0, sizeof still);
    bus_begin(w, &vs_base_gctronic, seed);
    bus_board(w, VS_BOARD_GROUND, rab_bytes);
    bus_board(w, VS_BOARD_RAB, rab_bytes);
    w->rab.is_stock = rab_bytes == 2;
    CHECK(bus_recover(w) == VS_OK);
    w->base.boards.rab_power = 90;
    for (i = 0; i < 5; i++) /* one setting each, and the reading of the last */
        CHECK(exchange(w) == VS_OK);
    CHECK(w->reading.boards.has[VS_BOARD_RAB] && w->rab.on_robot == 0 && w->rab.power == 90);
    CHECK(w->rab.light_stored == 1); /* real_epuck_range_and_bearing_sensor.cpp:141-144 */
    CHECK(w->rab.bits == 8 * rab_bytes);
}

static void test_ground(void)
{
    static const int16_t floors[3] = {0, 511, 1023};
    struct bus_world w;
    int i;

    start(&w, 2, 1);
    memcpy(w.ground.ground, floors, sizeof floors);
    CHECK(exchange(&w) == VS_OK && w.reading.boards.has[VS_BOARD_GROUND]);
    for (i = 0; i < 3; i++)
        CHECK(w.reading.boards.ground[i] == floors[i]);
    CHECK(vs_boards_are_well(&w.base.boards));
    w.ground.ground[1] = 1024; /* no sensor says that */
    CHECK(exchange(&w) == VS_OK && !w.reading.boards.has[VS_BOARD_GROUND]);
    CHECK(!vs_boards_are_well(&w.base.boards));
}

static struct epuck_rab_message make_message(uint32_t number, uint8_t bytes)
{
    struct epuck_rab_message message = {{0}, 0, 0};
    int i;

    for (i = 0; i < bytes; i++)
        message.data[i] = (uint8_t)(number >> (i % 2 * 8) & 0xFF);
    message.bearing_e4rad = (int16_t)((int32_t)(number * 7919u % (2 * PI_E4 + 1)) - PI_E4);
    message.range_raw = (uint16_t)(number * 31u);
    return message;
}

static void check_heard(const struct bus_world *w, uint32_t number, uint8_t bytes)
{
    const struct vs_board_reading *boards = &w->reading.boards;
    const struct epuck_rab_message *heard = &boards->heard[number % VS_BOARD_HEARD];
    struct epuck_rab_message message = make_message(number, bytes);

    CHECK(memcmp(heard->data, message.data, 4) == 0);
    CHECK(heard->bearing_e4rad == message.bearing_e4rad);
    CHECK(heard->range_raw == message.range_raw);
}

static void test_hears_every_message_once(uint8_t bytes, uint32_t seed)
{
    struct bus_world w;
    uint32_t sent = 0;
    uint32_t checked = 0;
    int i;

    start(&w, bytes, seed);
    for (i = 0; i < 200; i++) {
        uint32_t more = draw(&w.random, i < 150 ? 5 : 1);

        for (; more > 0; more--, sent++) {
            struct epuck_rab_message message = make_message(sent, bytes);

            fw_rab_hear(&w.rab, &message);
        }
        CHECK(exchange(&w) == VS_OK);
        CHECK(w.reading.boards.heard_count - checked <= VS_BOARD_HEARD);
        for (; checked < w.reading.boards.heard_count; checked++)
            check_heard(&w, checked, bytes);
    }
    CHECK(checked == sent && sent > 100 && w.rab.overflowed == 0);
}

/* What comes from the right has a bearing below 0. */
static void test_bearing_is_signed(void)
{
    struct epuck_rab_message message = {{1, 2, 0, 0}, -15708, 900};
    struct bus_world w;

    start(&w, 2, 4);
    fw_rab_hear(&w.rab, &message);
    CHECK(exchange(&w) == VS_OK && exchange(&w) == VS_OK);
    CHECK(w.reading.boards.heard_count == 1);
    CHECK(w.reading.boards.heard[0].bearing_e4rad == -15708);
    message.bearing_e4rad = INT16_MIN; /* beyond -pi: no board says that */
    fw_rab_hear(&w.rab, &message);
    CHECK(exchange(&w) == VS_OK && exchange(&w) == VS_OK);
    CHECK(w.reading.boards.heard_count == 1 && w.rab.queue_count == 0);
}

/* A new message at once, the same one again and again, but no faster than the air takes. */
static void test_says_its_message(uint8_t bytes)
{
    uint32_t number = bytes == 2 ? 0x0200 : 0x04030200;
    struct bus_world w;
    uint32_t sent;
    uint32_t i;

    start(&w, bytes, 5);
    for (i = 0; i < 5; i++)
        CHECK(exchange(&w) == VS_OK);
    CHECK(w.rab.sent == 0);
    for (i = 1; i < 300; i++) {
        struct vs_board_message message = {4, {(uint8_t)i, 2, 3, 4}};

        still.message = message;
        CHECK(exchange(&w) == VS_OK);
        CHECK(w.rab.sent == i && w.rab.sent_number == (number | (i & 0xFF)));
    }
    sent = w.rab.sent;
    for (i = 0; i < 20; i++)
        CHECK(exchange(&w) == VS_OK);
    CHECK(w.rab.sent >= sent + 9 && w.rab.sent <= sent + 11);
    still.message.length = 1; /* the other bytes are 0 then */
    CHECK(exchange(&w) == VS_OK && w.rab.sent_number == (299 & 0xFF));
    still.message.length = 0;
    sent = w.rab.sent;
    for (i = 0; i < 20; i++)
        CHECK(exchange(&w) == VS_OK);
    CHECK(w.rab.sent == sent);
}

/* A board that is not there, or falls silent, is told once, costs little, and comes back. */
static void test_missing_board(void)
{
    struct bus_world w;
    uint32_t transfers;
    int i;

    start(&w, 4, 6);
    w.rab.device.address = w.ground.device.address = 0x7F;
    CHECK(exchange(&w) == VS_OK && exchange(&w) == VS_OK);
    CHECK(!w.reading.boards.has[VS_BOARD_GROUND] && !w.reading.boards.has[VS_BOARD_RAB] &&
          w.base.news != NULL);
    w.base.news = NULL;
    transfers = w.transfers;
    for (i = 0; i < 15; i++)
        CHECK(exchange(&w) == VS_OK && w.base.news == NULL); /* 50 ms each */
    CHECK(w.transfers - transfers == 15); /* its own */
    w.rab.device.address = EPUCK_RAB_ADDRESS;
    w.ground.device.address = EPUCK_GROUND_ADDRESS;
    fw_rab_init(&w.rab); /* it was reset: its settings are gone */
    for (i = 0; i < 15; i++)
        CHECK(exchange(&w) == VS_OK);
    CHECK(w.reading.boards.has[VS_BOARD_GROUND] && w.reading.boards.has[VS_BOARD_RAB] &&
          w.base.news != NULL);
    CHECK(w.rab.bits == 32 && w.rab.light_stored == 1);
}

/* A board that holds the bus costs the base one time-out a second. */
static void test_stuck_board(uint32_t seed)
{
    struct bus_world w;
    int goods = 0;
    int i;

    start(&w, 2, seed);
    w.fault_one_in = 10;
    for (i = 0; i < 200; i++) {
        int err = exchange(&w);

        if (err != VS_OK && err != VS_ERR_BUSY)
            (void)bus_recover(&w);
        goods += err == VS_OK;
    }
    CHECK(goods > 20);
}

/* Its process is asked every 50 ms. */
static void look_at_battery(struct bus_world *w, int times)
{
    for (; times > 0; times--) {
        vs_boards_read_battery(&w->base.boards, w->now_ns + VS_BOARD_READ_NS, &w->base.news);
        vs_boards_take(&w->reading.boards, &w->base.boards.reading, VS_BOARD_BATTERY);
        bus_pass(w, 50 * MS);
    }
}

/* Once a second; what Linux's driver measured in between is not taken for the battery. */
static void test_battery(void)
{
    static const uint8_t other_channel[3] = {EPUCK_ADC_SETTINGS, 0xD3, 0x83};
    struct bus_world w;
    uint32_t transfers;

    bus_begin(&w, &vs_base_gctronic, 7);
    bus_board(&w, VS_BOARD_BATTERY, 2);
    CHECK(!vs_boards_are_well(&w.base.boards));
    w.adc.channels_mv[0] = 3700;
    w.adc.channels_mv[1] = 1234;
    look_at_battery(&w, 2);
    CHECK(w.reading.boards.battery_mv == 3700 && vs_boards_are_well(&w.base.boards));
    w.adc.channels_mv[0] = 3404;
    transfers = w.transfers;
    look_at_battery(&w, 60);
    CHECK(w.reading.boards.battery_mv == 3404 && w.transfers - transfers == 9);
    while (!w.base.boards.measuring)
        look_at_battery(&w, 1);
    w.adc.channels_mv[0] = 3000;
    CHECK(bus_transfer(&w, EPUCK_ADC_ADDRESS, other_channel, 3, NULL, 0) == VS_OK);
    look_at_battery(&w, 1);
    CHECK(w.reading.boards.battery_mv == 3404);
    look_at_battery(&w, 21);
    CHECK(w.reading.boards.battery_mv == 3000 && w.base.news == NULL);
    w.adc.device.address = 0x7F;
    look_at_battery(&w, 21);
    CHECK(w.reading.boards.battery_mv == 0 && w.base.news != NULL);
}

static void ask(struct bus_world *w, int board, const struct vs_board_request *request)
{
    vs_boards_ask(&w->base.boards, board, request, w->now_ns, &w->base.news);
    vs_boards_take(&w->reading.boards, &w->base.boards.reading, board);
}

/* Index 0 is front left, 1 front right, 2 back. Source: argos3-epuck 66cb8d9
 * ci_epuck_rgb_leds_actuator.h:9-17; the bytes: test_rgb_leds_of_iridia. */
static void test_rgb(void)
{
    static const struct vs_board_request colours = {{0, {0}}, {{255, 0, 1}, {2, 3, 4}, {5, 6, 7}}};
    static const struct vs_board_request dark;
    struct bus_world w;

    bus_begin(&w, &vs_base_gctronic, 8);
    bus_board(&w, VS_BOARD_RGB, 2);
    CHECK(!vs_boards_are_well(&w.base.boards));
    ask(&w, VS_BOARD_RGB, &colours);
    CHECK(w.reading.boards.has[VS_BOARD_RGB] && vs_boards_are_well(&w.base.boards) &&
          w.rgb.writes == 1);
    CHECK(memcmp(w.rgb.rgb, colours.rgb, sizeof colours.rgb) == 0);
    w.wires.faults.refuse = 1; /* once: it is tried again */
    ask(&w, VS_BOARD_RGB, &dark);
    CHECK(w.reading.boards.has[VS_BOARD_RGB] && memcmp(w.rgb.rgb, dark.rgb, sizeof dark.rgb) == 0);
    w.rgb.device.address = 0x7F;
    ask(&w, VS_BOARD_RGB, &colours);
    CHECK(!w.reading.boards.has[VS_BOARD_RGB] &&
          strstr(w.base.news, "RGB LEDs do not answer") != NULL);
    w.rgb.device.address = EPUCK_RGB_ADDRESS;
    ask(&w, VS_BOARD_RGB, &colours); /* it is left alone for a second */
    CHECK(!w.reading.boards.has[VS_BOARD_RGB] && w.rgb.writes == 2);
    bus_pass(&w, 1000 * MS);
    ask(&w, VS_BOARD_RGB, &colours);
    CHECK(w.reading.boards.has[VS_BOARD_RGB] &&
          memcmp(w.rgb.rgb, colours.rgb, sizeof colours.rgb) == 0);
    CHECK(strstr(w.base.news, "RGB LEDs answer again") != NULL);
    vs_boards_lose(&w.reading.boards, VS_BOARD_RGB);
    CHECK(!w.reading.boards.has[VS_BOARD_RGB]);
}

/* Whichever chip it is, and wherever, it is found within a request for each that it may be. */
static void test_imu(int chip, const int16_t raw[3], const int16_t rates[3])
{
    static const struct vs_board_request nothing;
    struct bus_world w;
    int i;

    bus_begin(&w, &vs_base_gctronic, 9);
    bus_board(&w, VS_BOARD_IMU, 2);
    fw_imu_init(&w.imu, chip);
    memcpy(w.imu.rates, raw, sizeof w.imu.rates);
    CHECK(!vs_boards_are_well(&w.base.boards));
    for (i = 0; i < EPUCK_IMUS && !w.reading.boards.has[VS_BOARD_IMU]; i++)
        ask(&w, VS_BOARD_IMU, &nothing);
    CHECK(w.reading.boards.has[VS_BOARD_IMU] && vs_boards_are_well(&w.base.boards) &&
          w.base.news == NULL);
    CHECK(memcmp(w.reading.boards.rates, rates, sizeof w.imu.rates) == 0);
    w.imu.device.address = 0x7F;
    ask(&w, VS_BOARD_IMU, &nothing);
    CHECK(!w.reading.boards.has[VS_BOARD_IMU] &&
          strstr(w.base.news, "IMU does not answer") != NULL);
    fw_imu_init(&w.imu, chip); /* it was switched off: an LSM330 has lost its settings */
    memcpy(w.imu.rates, raw, sizeof w.imu.rates);
    for (i = 0; i <= EPUCK_IMUS; i++) {
        bus_pass(&w, 1000 * MS);
        ask(&w, VS_BOARD_IMU, &nothing);
    }
    CHECK(w.reading.boards.has[VS_BOARD_IMU] && strstr(w.base.news, "IMU answers again") != NULL);
    CHECK(memcmp(w.reading.boards.rates, rates, sizeof w.imu.rates) == 0);
    vs_boards_lose(&w.reading.boards, VS_BOARD_IMU);
    CHECK(!w.reading.boards.has[VS_BOARD_IMU]);
}

/* An LSM330's digit is 8.75e-3 degrees a second, the others' 250 / 32768. Source: e-puck-library
 * 4cb85cb library/acc_gyro/e_lsm330.c:279-283; e-puck2_main-processor d2e0dbb
 * src/sensors/mpu9250.c:11-16. */
static void test_imus(void)
{
    static const int16_t raw[3] = {-32768, 1000, 32767};
    static const int16_t lsm330[3] = {-32768, 1148, 32767};
    int chip;

    for (chip = 0; chip < EPUCK_IMU_LSM330; chip++)
        test_imu(chip, raw, raw);
    test_imu(EPUCK_IMU_LSM330, raw, lsm330);
}

int main(void)
{
    uint32_t seed;

    test_ground();
    test_bearing_is_signed();
    test_says_its_message(2);
    test_says_its_message(4);
    test_missing_board();
    test_battery();
    test_rgb();
    test_imus();
    for (seed = 1; seed <= 20; seed++) {
        test_hears_every_message_once(2, seed);
        test_hears_every_message_once(4, seed);
        test_stuck_board(seed);
    }
    return 0;
}
