/* SPDX-License-Identifier: MIT */
/*
 * The base of an e-puck2 on Wi-Fi, on virtual time, against a far end that sends and acknowledges
 * what the input says: packets, other ones, halves, nothing, the end of the connection. Nothing
 * takes longer than it may; what is sent are whole commands, at no speed but the newest; each
 * connection begins with a stop; and a stop counts only when its bytes were acknowledged.
 */
#define vs_posix_now_ns virtual_now_ns
#define vs_posix_wait virtual_wait
#define vs_wifi_line_open far_open
#define vs_wifi_line_await far_await
#define vs_wifi_line_close far_close
#define vs_wifi_line_unheard far_unheard
#define vs_wifi_line_io far_io
#define vs_base_wifi base_of_this_target
#include "../../../robot/base_wifi.c"

#include "../../../robot/base_sensors.h"
#include "../../../c_src/vs_format.h"
#include "fuzz.h"

#define MS 1000000u
#define STEPS 60
#define READ_NS 50000u /* [ns] bytes that are there cost time, too */
#define READS_OF_A_STEP 800  /* of one exchange: a far end that never stops holds nobody up */

static struct world {
    struct vs_base base;
    struct vs_base_reading reading;
    struct input *in;
    uint64_t now_ns;
    int16_t left_steps_s, right_steps_s; /* newest command */
    uint32_t sent;      /* [byte] on this connection */
    uint32_t unheard;
    uint32_t rest_end;  /* [byte] up to the end of the newest run of stops' first one */
    uint32_t reads;     /* in this step */
    uint8_t is_open;
    uint8_t rests;
} far;

uint64_t virtual_now_ns(void)
{
    return far.now_ns;
}

static void pass_until(uint64_t deadline_ns)
{
    if (far.now_ns < deadline_ns)
        far.now_ns = deadline_ns;
}

int virtual_wait(int fd, short events, uint64_t deadline_ns)
{
    CHECK(fd == -1 && events == 0 && deadline_ns <= far.now_ns + VS_BASE_EXCHANGE_NS);
    pass_until(deadline_ns);
    return VS_ERR_BUSY;
}

int far_open(const uint8_t address[4], uint16_t port, int *fd)
{
    CHECK(address[0] == 192 && port == 1000 && !far.is_open);
    if (take_below(far.in, 8) == 7)
        return VS_ERR_IO;
    *fd = 3;
    far.is_open = 1;
    far.sent = far.unheard = far.rest_end = 0;
    far.rests = 0;
    return VS_OK;
}

int far_await(int fd, uint64_t deadline_ns)
{
    uint32_t how = take_below(far.in, 8);

    CHECK(fd == 3 && far.is_open);
    if (how < 6)
        return VS_OK;
    pass_until(deadline_ns);
    return how == 6 ? VS_ERR_BUSY : VS_ERR_IO;
}

void far_close(int *fd)
{
    *fd = -1;
    far.is_open = 0;
}

int far_unheard(int fd)
{
    CHECK(fd == 3);
    far.unheard = take_below(far.in, 1 + (far.sent < 200 ? far.sent : 200));
    return take_u8(far.in) == 255 ? -1 : (int)far.unheard;
}

static uint64_t io_now(void *context)
{
    (void)context;
    return far.now_ns;
}

static int io_read(void *context, uint8_t *buf, size_t cap, uint64_t deadline_ns)
{
    uint8_t how = take_u8(far.in);
    size_t len = 1 + EPUCK_WIFI_SENSORS_LEN;

    (void)context;
    CHECK(far.is_open && cap >= len);
    if (far.in->left == 0 || how >= 240) {
        pass_until(deadline_ns);
        return how == 255 ? VS_ERR_HANGUP : how == 254 ? VS_ERR_IO : 0;
    }
    CHECK(++far.reads <= READS_OF_A_STEP);
    far.now_ns += READ_NS;
    if (far.now_ns + (uint64_t)(how % 4) * MS <= deadline_ns)
        far.now_ns += (uint64_t)(how % 4) * MS;
    if (how < 60)
        len = 1 + take_u8(far.in);
    take_into(far.in, buf, len);
    if (how >= 120) { /* as a robot's: numbers that it can measure */
        buf[0] = EPUCK_WIFI_SENSORS;
        for (len = 1; len <= EPUCK_WIFI_SENSORS_LEN; len++)
            buf[len] = len % 2 == 0 ? 0 : buf[len];
    }
    return (int)len;
}

static int io_write(void *context, const uint8_t *buf, size_t len, uint64_t deadline_ns)
{
    struct epuck_wifi_command command;
    int i, rests;

    (void)context;
    (void)deadline_ns;
    CHECK(far.is_open && len == EPUCK_WIFI_COMMAND_LEN && epuck_wifi_get_command(buf, &command) == 0);
    rests = command.left_steps_s == 0 && command.right_steps_s == 0;
    CHECK(rests || (command.left_steps_s == far.left_steps_s &&
                    command.right_steps_s == far.right_steps_s));
    CHECK(rests || far.sent > 0);
    for (i = 0; i < 12; i++)
        CHECK(command.rgb[i / 3][i % 3] <= EPUCK_WIFI_BRIGHTNESS_MAX);
    if (take_u8(far.in) == 255)
        return VS_ERR_IO;
    far.sent += (uint32_t)len;
    if (rests && !far.rests)
        far.rest_end = far.sent;
    far.rests = (uint8_t)rests;
    return VS_OK;
}

void far_io(struct vs_io *io, int *fd)
{
    (void)fd;
    io->now_ns = io_now;
    io->read = io_read;
    io->write = io_write;
    io->expect = NULL;
}

static void check_values(void)
{
    double values[VS_BASE_NUMBERS_MAX];
    int sensor, count, i;

    for (sensor = 0; sensor < VS_BASE_SENSORS; sensor++) {
        count = vs_base_values(&far.reading, sensor, 0, values, VS_BASE_NUMBERS_MAX);
        CHECK(count >= 0 && count <= VS_BASE_NUMBERS_MAX);
        for (i = 0; i < count; i++)
            CHECK(values[i] - values[i] == 0.0);
    }
}

static void step(void)
{
    static const struct vs_base_command rest;
    struct vs_base_command command = rest;
    uint64_t began_ns = far.now_ns;
    int err;

    far.reads = 0;
    switch (take_below(far.in, 4)) {
    case 0:
        err = base_of_this_target.recover(&far.base);
        break;
    case 1:
        err = base_of_this_target.close(&far.base);
        break;
    default:
        far.left_steps_s = command.left_steps_s = (int16_t)(take_below(far.in, 5) * 100);
        far.right_steps_s = command.right_steps_s = (int16_t)(command.left_steps_s / -2);
        command.leds = take_u16(far.in);
        take_into(far.in, command.rgb, sizeof command.rgb);
        err = base_of_this_target.exchange(&far.base, &command, &far.reading);
        if (err == VS_OK)
            check_values();
        if (err == VS_OK && command.left_steps_s == 0)
            CHECK(far.sent - far.unheard >= far.rest_end || far.unheard == 0 || far.rests);
    }
    CHECK(err == VS_OK || err == VS_ERR_LATE || err == VS_ERR_BUSY || err == VS_ERR_SILENT ||
          err == VS_ERR_IO);
    CHECK(far.now_ns - began_ns <= VS_BASE_EXCHANGE_NS + 8 * MS);
    far.now_ns += (uint64_t)take_u8(far.in) * MS;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct vs_base_config config;
    struct input in = {data, size};
    int i;

    vs_format(config.device, sizeof config.device, "192.168.1.40");
    memset(&far, 0, sizeof far);
    far.in = &in;
    far.now_ns = 10000 * (uint64_t)MS;
    far.base.ops = &base_of_this_target;
    CHECK(base_of_this_target.open(&far.base, &config) == VS_OK);
    for (i = 0; i < STEPS && in.left > 0; i++)
        step();
    return 0;
}
