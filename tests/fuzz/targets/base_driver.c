/* SPDX-License-Identifier: MIT */
/*
 * The base that is a driver, on virtual time, against one that writes what the input says: reports,
 * changed ones, pieces, nothing, its own end. Nothing takes longer than it may; a new driver is
 * told to rest first; orders name only the newest command, and a time that is near; a stop counts
 * only when the driver says that it follows it; what is no report ends the driver.
 */
#define vs_posix_now_ns virtual_now_ns
#define vs_posix_recent_ns virtual_now_ns
#define vs_posix_wait virtual_wait
#define vs_driver_clock_ns virtual_clock_ns
#define vs_driver_open virtual_open
#define vs_driver_runs virtual_runs
#define vs_driver_start virtual_start
#define vs_driver_kill virtual_kill
#define vs_base_exec base_of_this_target
#include "../../../robot/driver.c"

#include <fcntl.h>
#include <unistd.h>

#include "../../../c_src/vs_bytes.h"
#include "../../../robot/base_sensors.h"
#include "fuzz.h"

#define MS 1000000u
#define STEPS 60
#define AHEAD_NS (5000 * (uint64_t)MS) /* of the other clock */

static struct world {
    struct vs_base base;
    struct vs_base_reading reading;
    struct vs_driver driver;
    struct input *in;
    uint64_t now_ns;
    int16_t left_steps_s, right_steps_s; /* newest command */
    uint64_t order_ns, rest_ns;          /* newest order; first of those to rest, 0: the last drives */
    uint64_t said_ns;                    /* the newest that a whole report followed */
    uint8_t orders;                      /* of this driver */
    uint8_t exact;                       /* only whole, true reports were written so far */
} w;
static int ends[2];

uint64_t virtual_now_ns(void)
{
    return w.now_ns;
}

uint64_t virtual_clock_ns(void)
{
    return w.now_ns + AHEAD_NS;
}

int virtual_open(struct vs_driver_line *line, const char *command)
{
    line->command = command;
    line->driver = &w.driver;
    line->own = ends[0];
    line->theirs = ends[1];
    return VS_OK;
}

int virtual_runs(struct vs_driver_line *line, uint64_t now_ns)
{
    if (line->driver->pid != 0 && (line->driver->killed_ns != 0 || take_u8(w.in) == 255)) {
        line->driver->how = (int)take_u16(w.in);
        line->driver->pid = 0;
        line->driver->killed_ns = 0;
    }
    (void)now_ns;
    return line->driver->pid != 0;
}

static void empty(int fd)
{
    uint8_t scrap[4096];

    while (recv(fd, scrap, sizeof scrap, MSG_DONTWAIT) > 0)
        ;
}

int virtual_start(struct vs_driver_line *line, uint64_t now_ns)
{
    empty(ends[0]);
    empty(ends[1]);
    memset(&w.driver, 0, sizeof w.driver);
    line->driver->started_ns = now_ns;
    line->driver->pid = 1;
    w.orders = 0;
    w.order_ns = w.rest_ns = w.said_ns = 0;
    return VS_OK;
}

void virtual_kill(struct vs_driver_line *line, uint64_t now_ns)
{
    if (line->driver->pid != 0 && line->driver->killed_ns == 0)
        line->driver->killed_ns = now_ns;
}

static int32_t speed(int16_t steps_s)
{
    return (int32_t)((int64_t)steps_s * vs_body_epuck.step_nm / 1000);
}

/* Takes the orders that came, as a driver does: whole ones. */
static void take_orders(void)
{
    uint8_t order[VS_DRIVER_ORDER_LEN];
    ssize_t len;

    while ((len = recv(ends[1], order, sizeof order, MSG_DONTWAIT)) > 0) {
        int32_t left = (int32_t)vs_load_u32(order + 24);
        int32_t right = (int32_t)vs_load_u32(order + 28);
        int rests = left == 0 && right == 0;

        CHECK(len == VS_DRIVER_ORDER_LEN && memcmp(order, "vsd\1", 4) == 0);
        CHECK(rests || (left == speed(w.left_steps_s) && right == speed(w.right_steps_s)));
        CHECK(rests || w.orders > 0);
        CHECK(vs_load_u64(order + 8) >= w.order_ns);
        CHECK(vs_load_u64(order + 16) <= vs_load_u64(order + 8) + (rests ? 0 : 251 * (uint64_t)MS));
        w.order_ns = vs_load_u64(order + 8);
        if (!rests)
            w.rest_ns = 0;
        else if (w.rest_ns == 0)
            w.rest_ns = w.order_ns;
        w.orders = 1;
    }
}

static void write_report(uint8_t how)
{
    uint8_t report[VS_DRIVER_REPORT_LEN];
    size_t len = sizeof report;

    take_into(w.in, report, sizeof report);
    if (how % 8 != 0) {
        memcpy(report, "vsd\1", 4);
        (void)vs_store_u64(report + 8, w.order_ns - (how % 8 == 1 && w.order_ns > 0));
        (void)vs_store_u64(report + 16, virtual_clock_ns() - take_u8(w.in) * (uint64_t)MS);
        report[44] = how % 8 == 2 ? report[44] : 255;
        report[45] = report[46] = report[47] = 4;
    }
    if (how % 8 <= 2)
        w.exact = 0;
    if (how % 8 == 3)
        len = take_u8(w.in) % sizeof report, w.exact = 0;
    CHECK(send(ends[1], report, len, MSG_DONTWAIT | MSG_NOSIGNAL) == (ssize_t)len || len == 0);
    if (how % 8 > 3)
        w.said_ns = w.order_ns;
}

int virtual_wait(int fd, short events, uint64_t deadline_ns)
{
    uint8_t how = take_u8(w.in);
    uint8_t peeked;

    CHECK(fd == ends[0] && deadline_ns <= w.now_ns + VS_BASE_EXCHANGE_NS);
    take_orders();
    if (how >= 128 && w.in->left > 0 && events != 0)
        write_report(how);
    if (events != 0 && recv(fd, &peeked, 1, MSG_DONTWAIT | MSG_PEEK) == 1) {
        w.now_ns += (uint64_t)(how % 4) * MS;
        return w.now_ns < deadline_ns ? VS_OK : VS_ERR_BUSY;
    }
    if (w.now_ns < deadline_ns)
        w.now_ns = deadline_ns;
    return VS_ERR_BUSY;
}

static void check_values(void)
{
    double values[VS_BASE_NUMBERS_MAX];
    int sensor, count, i;

    for (sensor = 0; sensor < VS_BASE_SENSORS; sensor++) {
        count = vs_base_values(&w.reading, sensor, 0, values, VS_BASE_NUMBERS_MAX);
        CHECK(count >= 0 && count <= VS_BASE_NUMBERS_MAX);
        for (i = 0; i < count; i++)
            CHECK(values[i] - values[i] == 0.0);
    }
}

static void step(void)
{
    static const struct vs_base_command rest;
    struct vs_base_command command = rest;
    uint64_t began_ns = w.now_ns;
    int err;

    switch (take_below(w.in, 4)) {
    case 0:
        err = base_of_this_target.recover(&w.base);
        break;
    case 1:
        err = base_of_this_target.close(&w.base);
        break;
    default:
        w.left_steps_s = command.left_steps_s = (int16_t)(take_below(w.in, 5) * 100);
        w.right_steps_s = command.right_steps_s = (int16_t)(command.left_steps_s / -2);
        w.base.until_ns = w.now_ns + 1 + take_u8(w.in) % 250 * (uint64_t)MS;
        err = base_of_this_target.exchange(&w.base, &command, &w.reading);
        if (err == VS_OK)
            check_values();
        take_orders();
        if (err == VS_OK && command.left_steps_s == 0 && w.exact)
            CHECK(w.said_ns >= w.rest_ns);
    }
    take_orders();
    CHECK(err == VS_OK || err == VS_ERR_LATE || err == VS_ERR_BUSY || err == VS_ERR_SILENT ||
          err == VS_ERR_GARBLED || err == VS_ERR_IO);
    CHECK(w.now_ns - began_ns <= VS_BASE_EXCHANGE_NS + 4 * MS);
    CHECK(err != VS_ERR_GARBLED || w.driver.killed_ns != 0);
    w.now_ns += (uint64_t)take_u8(w.in) * MS;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct vs_base_config config;
    struct input in = {data, size};
    int i;

    if (ends[0] == ends[1])
        CHECK(socketpair(AF_UNIX, SOCK_STREAM, 0, ends) == 0);
    memset(&w, 0, sizeof w);
    w.in = &in;
    w.exact = 1;
    w.now_ns = 10000 * (uint64_t)MS;
    w.base.ops = &base_of_this_target;
    CHECK(base_of_this_target.open(&w.base, &config) == VS_OK);
    for (i = 0; i < STEPS && in.left > 0; i++)
        step();
    return 0;
}
