/* SPDX-License-Identifier: MIT */
#include "base_boards.h"

#include <string.h>

enum { SETTINGS = 4 };

static uint64_t now(const struct vs_boards *boards, int board)
{
    return boards->bus[board].now_ns(boards->bus[board].context);
}

/* Keeps in mind whether a board answers; returns err. */
static int note(struct vs_boards *boards, int board, int err, const char **news)
{
    static const char *const fallen[VS_BOARDS] = {
        "the ground sensors do not answer", "the range-and-bearing board does not answer",
        "the battery's converter does not answer", "the RGB LEDs do not answer",
        "the IMU does not answer"};
    static const char *const back[VS_BOARDS] = {
        "the ground sensors answer again", "the range-and-bearing board answers again",
        "the battery's converter answers again", "the RGB LEDs answer again",
        "the IMU answers again"};
    uint8_t bit = (uint8_t)(1u << board);
    uint8_t silent = err == VS_OK ? 0 : bit;

    if ((boards->silent & bit) != silent)
        *news = silent ? fallen[board] : back[board];
    boards->silent = (uint8_t)((boards->silent & ~bit) | silent);
    if (silent)
        boards->rest_ns[board] = now(boards, board) + VS_BOARD_REST_NS;
    return err;
}

/* 1 if a board is on a bus, is to be asked now, and there is time for it. */
static int may_ask(const struct vs_boards *boards, int board, uint64_t deadline_ns)
{
    return boards->bus[board].transfer != NULL && now(boards, board) >= boards->rest_ns[board] &&
           vs_i2c_has_time(&boards->bus[board], deadline_ns);
}

void vs_boards_read_ground(struct vs_boards *boards, uint64_t deadline_ns, const char **news)
{
    static const uint8_t first = 0;
    struct vs_i2c *bus = &boards->bus[VS_BOARD_GROUND];
    uint8_t registers[EPUCK_GROUND_LEN];
    int err;

    if (!may_ask(boards, VS_BOARD_GROUND, deadline_ns))
        return;
    err = vs_i2c_insist(bus, EPUCK_GROUND_ADDRESS, &first, 1, registers, sizeof registers,
                        deadline_ns);
    if (err == VS_ERR_BUSY)
        return;
    boards->reading.has[VS_BOARD_GROUND] = note(boards, VS_BOARD_GROUND, err, news) == VS_OK &&
                                 epuck_ground_get(registers, boards->reading.ground) == 0;
}

/* Reads the conversion, unless somebody has asked the converter for another one since: Linux has
 * a driver for it. */
static int read_conversion(struct vs_boards *boards, uint64_t deadline_ns)
{
    static const uint8_t settings = EPUCK_ADC_SETTINGS;
    static const uint8_t value = EPUCK_ADC_VALUE;
    struct vs_i2c *bus = &boards->bus[VS_BOARD_BATTERY];
    uint8_t in[2];
    int err = vs_i2c_insist(bus, EPUCK_ADC_ADDRESS, &settings, 1, in, sizeof in, deadline_ns);

    if (err != VS_OK || in[0] != EPUCK_ADC_BATTERY >> 8 || in[1] != (EPUCK_ADC_BATTERY & 0xFF))
        return err;
    err = vs_i2c_insist(bus, EPUCK_ADC_ADDRESS, &value, 1, in, sizeof in, deadline_ns);
    if (err == VS_OK)
        boards->reading.battery_mv = epuck_adc_get_battery(in);
    return err;
}

void vs_boards_read_battery(struct vs_boards *boards, uint64_t deadline_ns, const char **news)
{
    static const uint8_t begin[3] = {EPUCK_ADC_SETTINGS, EPUCK_ADC_BATTERY >> 8,
                                     EPUCK_ADC_BATTERY & 0xFF};
    uint64_t since_ns;
    int err;

    if (!may_ask(boards, VS_BOARD_BATTERY, deadline_ns))
        return;
    since_ns = now(boards, VS_BOARD_BATTERY) - boards->measured_ns;
    if (since_ns < (boards->measuring ? EPUCK_ADC_TIME_NS : VS_BOARD_MEASURE_NS))
        return;
    if (boards->measuring)
        err = read_conversion(boards, deadline_ns);
    else
        err = vs_i2c_insist(&boards->bus[VS_BOARD_BATTERY], EPUCK_ADC_ADDRESS, begin,
                            sizeof begin, NULL, 0, deadline_ns);
    if (err == VS_ERR_BUSY)
        return;
    boards->measuring = !boards->measuring && err == VS_OK;
    if (boards->measuring)
        boards->measured_ns = now(boards, VS_BOARD_BATTERY);
    if (note(boards, VS_BOARD_BATTERY, err, news) != VS_OK)
        boards->reading.battery_mv = 0;
    boards->reading.has[VS_BOARD_BATTERY] = boards->reading.battery_mv != 0;
}

void vs_boards_shine(struct vs_boards *boards, const uint8_t rgb[EPUCK_RGB_LEDS][3],
                     uint64_t deadline_ns, const char **news)
{
    uint8_t out[EPUCK_RGB_LEN];
    int err;

    boards->reading.has[VS_BOARD_RGB] = 0;
    if (!may_ask(boards, VS_BOARD_RGB, deadline_ns))
        return;
    epuck_rgb_put(rgb, out);
    err = vs_i2c_insist(&boards->bus[VS_BOARD_RGB], EPUCK_RGB_ADDRESS, out, sizeof out, NULL, 0,
                        deadline_ns);
    if (err != VS_ERR_BUSY)
        boards->reading.has[VS_BOARD_RGB] = note(boards, VS_BOARD_RGB, err, news) == VS_OK;
}

void vs_boards_read_imu(struct vs_boards *boards, uint64_t deadline_ns, const char **news)
{
    int err;

    if (!may_ask(boards, VS_BOARD_IMU, deadline_ns))
        return;
    err = vs_imu_read(&boards->imu, &boards->bus[VS_BOARD_IMU], boards->reading.rates,
                      deadline_ns);
    if (err != VS_ERR_BUSY)
        boards->reading.has[VS_BOARD_IMU] = note(boards, VS_BOARD_IMU, err, news) == VS_OK;
}

static int write_register(struct vs_boards *boards, uint8_t number, uint8_t value,
                          uint64_t deadline_ns)
{
    uint8_t out[2] = {number, value};

    return vs_i2c_insist(&boards->bus[VS_BOARD_RAB], EPUCK_RAB_ADDRESS, out, sizeof out, NULL, 0,
                         deadline_ns);
}

/* One byte at a time: a second one would be the first again. */
static int read_register(struct vs_boards *boards, uint8_t number, uint8_t *value,
                         uint64_t deadline_ns)
{
    return vs_i2c_insist(&boards->bus[VS_BOARD_RAB], EPUCK_RAB_ADDRESS, &number, 1, value, 1,
                         deadline_ns);
}

/* In ARGoS' order; the board needs a pause after each of them. */
static int write_setting(struct vs_boards *boards, uint64_t deadline_ns)
{
    const uint8_t settings[SETTINGS][2] = {
        {EPUCK_RAB_ON_ROBOT, 0},
        {EPUCK_RAB_STORE_LIGHT, 0},
        {EPUCK_RAB_BITS, (uint8_t)(8 * boards->reading.rab_bytes)},
        {EPUCK_RAB_POWER, boards->rab_power},
    };
    const uint8_t *next = settings[boards->settings];
    int err = write_register(boards, next[0], next[1], deadline_ns);

    if (err == VS_OK)
        boards->settings++;
    return err;
}

/* Byte number of a message as long as the board's are. */
static uint8_t byte_of(const struct vs_board_message *message, int number)
{
    return number < message->length ? message->data[number] : 0;
}

static int is_said(const struct vs_boards *boards, const struct vs_board_message *message)
{
    int i;

    for (i = 0; i < boards->reading.rab_bytes; i++)
        if (byte_of(message, i) != byte_of(&boards->message, i))
            return 0;
    return message->length == boards->message.length;
}

/* Writes on in a message; the last byte sends it. */
static int say(struct vs_boards *boards, const struct vs_board_message *message,
               uint64_t deadline_ns)
{
    uint8_t bytes = boards->reading.rab_bytes;
    const uint8_t *registers = epuck_rab_writes(bytes);

    if (boards->saying == 0)
        boards->message = *message;
    while (boards->saying < bytes) {
        int err = write_register(boards, registers[boards->saying],
                                 byte_of(&boards->message, bytes - 1 - boards->saying),
                                 deadline_ns);

        if (err != VS_OK)
            return err;
        boards->saying++;
    }
    boards->saying = 0;
    return VS_OK;
}

/* Reads on in the message that was taken. */
static int hear(struct vs_boards *boards, uint64_t deadline_ns)
{
    struct vs_board_reading *reading = &boards->reading;
    size_t count;
    const uint8_t *registers = epuck_rab_reads(reading->rab_bytes, &count);

    while (boards->held_count < count) {
        int err = read_register(boards, registers[boards->held_count],
                                &boards->held[boards->held_count], deadline_ns);

        if (err != VS_OK)
            return err;
        boards->held_count++;
    }
    boards->hearing = 0;
    if (epuck_rab_get(boards->held, reading->rab_bytes,
                      &reading->heard[reading->heard_count % VS_BOARD_HEARD]) == 0)
        reading->heard_count++;
    return VS_OK;
}

/* Empties the board's queue, or as much of it as there is time for. */
static int listen(struct vs_boards *boards, uint64_t deadline_ns)
{
    int err = boards->hearing ? hear(boards, deadline_ns) : VS_OK;

    while (err == VS_OK) {
        uint8_t taken;

        err = read_register(boards, EPUCK_RAB_TAKE, &taken, deadline_ns);
        if (err != VS_OK)
            break;
        boards->listening = boards->hearing = taken == 1;
        if (!boards->listening)
            break;
        boards->held_count = 0;
        err = hear(boards, deadline_ns);
    }
    return err;
}

/* Settings first, then what there is to say. */
static int write_next(struct vs_boards *boards, const struct vs_board_message *message,
                      uint64_t now_ns, uint64_t deadline_ns)
{
    uint64_t pause_ns = is_said(boards, message) ? VS_BOARD_SAY_NS : EPUCK_RAB_GAP_NS;

    if (boards->settings < SETTINGS) {
        if (now_ns - boards->wrote_ns < EPUCK_RAB_GAP_NS)
            return VS_OK;
        boards->wrote_ns = now_ns;
        return write_setting(boards, deadline_ns);
    }
    if (boards->saying == 0) {
        if (message->length == 0 || now_ns - boards->wrote_ns < pause_ns)
            return VS_OK;
        boards->wrote_ns = now_ns;
    }
    return say(boards, message, deadline_ns);
}

static int serve_rab(struct vs_boards *boards, const struct vs_board_message *message,
                     uint64_t deadline_ns)
{
    uint64_t now_ns = now(boards, VS_BOARD_RAB);
    int err = write_next(boards, message, now_ns, deadline_ns);

    if (err != VS_OK || boards->settings < SETTINGS)
        return err;
    if (!boards->listening && now_ns - boards->polled_ns < EPUCK_RAB_GAP_NS)
        return VS_OK;
    boards->listening = 1;
    boards->polled_ns = now_ns;
    return listen(boards, deadline_ns);
}

/* A board that fell silent may have been reset, and lost its settings. */
static void forget(struct vs_boards *boards)
{
    boards->settings = 0;
    boards->saying = 0;
    boards->listening = 0;
    boards->hearing = 0;
}

int vs_boards_talk(struct vs_boards *boards, const struct vs_board_message *message,
                   uint64_t deadline_ns, const char **news)
{
    int err;

    if (!may_ask(boards, VS_BOARD_RAB, deadline_ns))
        return 0;
    err = serve_rab(boards, message, deadline_ns);
    if (err == VS_ERR_BUSY)
        return 1;
    if (note(boards, VS_BOARD_RAB, err, news) != VS_OK)
        forget(boards);
    boards->reading.has[VS_BOARD_RAB] = boards->settings == SETTINGS;
    return 0;
}

static void talk(struct vs_boards *boards, const struct vs_board_message *message,
                 uint64_t now_ns, const char **news)
{
    int i = 0;

    while (vs_boards_talk(boards, message, now_ns + VS_BOARD_TALK_NS, news) &&
           ++i < VS_BOARD_TALKS)
        now_ns = now(boards, VS_BOARD_RAB);
}

void vs_boards_ask(struct vs_boards *boards, int board, const struct vs_board_request *request,
                   uint64_t now_ns, const char **news)
{
    uint64_t deadline_ns = now_ns + VS_BOARD_READ_NS;

    if (board == VS_BOARD_GROUND)
        vs_boards_read_ground(boards, deadline_ns, news);
    else if (board == VS_BOARD_BATTERY)
        vs_boards_read_battery(boards, deadline_ns, news);
    else if (board == VS_BOARD_RGB)
        vs_boards_shine(boards, request->rgb, deadline_ns, news);
    else if (board == VS_BOARD_IMU)
        vs_boards_read_imu(boards, deadline_ns, news);
    else
        talk(boards, &request->message, now_ns, news);
}

void vs_boards_take(struct vs_board_reading *all, const struct vs_board_reading *one, int board)
{
    all->has[board] = one->has[board];
    if (board == VS_BOARD_GROUND) {
        memcpy(all->ground, one->ground, sizeof all->ground);
    } else if (board == VS_BOARD_BATTERY) {
        all->battery_mv = one->battery_mv;
    } else if (board == VS_BOARD_IMU) {
        memcpy(all->rates, one->rates, sizeof all->rates);
    } else if (board == VS_BOARD_RAB) {
        all->heard_count = one->heard_count;
        memcpy(all->heard, one->heard, sizeof all->heard);
    }
}

void vs_boards_lose(struct vs_board_reading *all, int board)
{
    all->has[board] = 0;
    if (board == VS_BOARD_BATTERY)
        all->battery_mv = 0;
}

int vs_boards_are_well(const struct vs_boards *boards)
{
    int board;

    for (board = 0; board < VS_BOARDS; board++)
        if (boards->bus[board].transfer != NULL && !boards->reading.has[board])
            return 0;
    return 1;
}
