/* SPDX-License-Identifier: MIT */
/*
 * driver.c - the base that is a program of any language (DRIVERS.md). An order is sent with every
 * exchange, and a report that says which order the robot follows is its answer. While wheels shall
 * turn, any new report will do; that they rest is believed of a report that follows such an order.
 * A driver that is late, silent or wrong is ended, and another one started, whose first order is
 * to rest. Guard and worker have the line in common (driver_process.h).
 */
#include "base_config.h"
#include "driver_process.h"

#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>

#include "../c_src/epuck_boards.h"
#include "../c_src/epuck_imu.h"
#include "../c_src/vs_body.h"
#include "../c_src/vs_posix.h"

#define LATE_NS 300000000u          /* [ns] it owes a report */
#define START_NS UINT64_C(10000000000) /* [ns] until its first report: an interpreter has to start */
#define NM_PER_UM 1000

enum { RING = 8, NOT_FOUND = 126 /* what a shell ends with from here on */ };

struct exec {
    struct vs_driver_line line;
    struct vs_base_body body; /* what the newest driver can do */
    uint8_t troubled;         /* it was told that one failed */
};

enum { STATE_FITS = 1 / (sizeof(struct exec) <= VS_BASE_STATE_MAX) };

static struct exec *of(struct vs_base *base)
{
    return (struct exec *)(void *)base->state.bytes;
}

static int open_exec(struct vs_base *base, const struct vs_base_config *config)
{
    struct exec *e = of(base);

    e->body = vs_body_epuck;
    base->body = &e->body;
    return vs_driver_open(&e->line, config->device);
}

static int fail(struct vs_base *base, int err, const char *news)
{
    struct exec *e = of(base);

    vs_driver_kill(&e->line, vs_posix_recent_ns());
    base->news = news;
    e->troubled = 1;
    return err;
}

/* 1: there is a driver. One that has just ended is told. */
static int runs(struct vs_base *base)
{
    struct exec *e = of(base);
    struct vs_driver *driver = e->line.driver;
    int before = driver->pid;
    int killed = driver->killed_ns != 0;

    if (vs_driver_runs(&e->line, vs_posix_now_ns()))
        return 1;
    if (before == 0 || killed)
        return 0;
    if (WIFEXITED(driver->how) && WEXITSTATUS(driver->how) >= NOT_FOUND)
        (void)fail(base, 0, "the driver's command cannot be run: is it there, and executable?");
    else
        (void)fail(base, 0, "the driver ended: starting another");
    return 0;
}

static int take(struct vs_base *base, struct vs_driver_report *report)
{
    struct vs_driver *driver = of(base)->line.driver;
    int err = vs_driver_get_report(driver->buf, report);

    driver->got = 0;
    if (err == VS_ERR_VERSION)
        return fail(base, VS_ERR_GARBLED, "the driver is of another version of DRIVERS.md");
    if (err != VS_OK || report->order_ns > driver->sent_ns ||
        report->measured_ns > vs_driver_clock_ns())
        return fail(base, VS_ERR_GARBLED, "the driver writes what is no report: does it print?");
    if (driver->order_ns == 0) /* it may have a queue of them to go through */
        driver->asked_ns = vs_driver_clock_ns();
    driver->order_ns = report->order_ns;
    if (driver->order_ns > driver->asked_ns)
        driver->asked_ns = driver->order_ns;
    return VS_OK;
}

/* Takes the newest report of those that are there. VS_OK: *report is new, VS_ERR_BUSY, or how the
 * driver failed. */
static int hear(struct vs_base *base, struct vs_driver_report *report)
{
    struct exec *e = of(base);
    struct vs_driver *driver = e->line.driver;
    int heard = VS_ERR_BUSY;
    int err = VS_OK;

    while (err == VS_OK) {
        ssize_t len = recv(e->line.own, driver->buf + driver->got,
                           sizeof driver->buf - driver->got, MSG_DONTWAIT);

        if (len <= 0)
            return heard;
        driver->got += (uint32_t)len;
        if (driver->got < sizeof driver->buf)
            continue;
        err = take(base, report);
        heard = err;
    }
    return err;
}

/* Its newest answer is too old, and not because nobody asked. */
static int is_late(const struct vs_driver *driver)
{
    if (driver->order_ns == 0)
        return vs_posix_recent_ns() - driver->started_ns > START_NS;
    return driver->order_ns < driver->sent_ns && vs_driver_clock_ns() - driver->asked_ns > LATE_NS;
}

static int32_t um_s(int16_t steps_s, uint32_t step_nm)
{
    return (int32_t)((int64_t)steps_s * step_nm / NM_PER_UM);
}

/* One that starts is told to rest until it answers: its robot may not be there at first. */
static void send_order(struct vs_base *base, const struct vs_base_command *command, uint32_t flags)
{
    struct exec *e = of(base);
    struct vs_driver *driver = e->line.driver;
    struct vs_driver_order order = {flags, vs_driver_clock_ns(), 0, 0, 0, command->leds, {{0}}};
    int rests = (command->left_steps_s | command->right_steps_s) == 0;
    uint8_t buf[VS_DRIVER_ORDER_LEN];
    int lasts_ms = vs_posix_timeout_ms(vs_posix_recent_ns(), base->until_ns);

    if (driver->order_ns == 0 && !rests)
        return;
    order.until_ns = order.sent_ns + (rests ? 0 : (uint64_t)lasts_ms * 1000000u);
    order.left_um_s = um_s(command->left_steps_s, e->body.step_nm);
    order.right_um_s = um_s(command->right_steps_s, e->body.step_nm);
    memcpy(order.rgb, command->rgb, sizeof order.rgb);
    if (!rests || driver->rest_ns == 0)
        driver->rest_ns = rests ? order.sent_ns : 0;
    if (driver->order_ns == driver->sent_ns)
        driver->asked_ns = order.sent_ns;
    driver->sent_ns = order.sent_ns;
    vs_driver_put_order(&order, buf);
    /* one that takes nothing answers nothing, and that is noticed */
    (void)send(e->line.own, buf, sizeof buf, MSG_NOSIGNAL | MSG_DONTWAIT);
}

static void count(struct exec *e, const struct vs_driver_report *report,
                  struct vs_base_reading *reading)
{
    struct vs_driver *driver = e->line.driver;
    int i;

    for (i = 0; i < 2; i++) {
        int64_t way_um = driver->counting ? report->way_um[i] - driver->way_um[i] : 0;
        int64_t way_nm = way_um * NM_PER_UM + driver->rest_nm[i];

        driver->steps[i] += (uint32_t)(way_nm / e->body.step_nm);
        driver->rest_nm[i] = (int32_t)(way_nm % e->body.step_nm);
        driver->way_um[i] = report->way_um[i];
        reading->steps[i] = (int32_t)driver->steps[i];
    }
    driver->counting = 1;
    reading->has_steps = 1;
}

static int16_t limited(double value)
{
    if (value > INT16_MAX)
        return INT16_MAX;
    return (int16_t)(value < INT16_MIN ? INT16_MIN : value);
}

/* Today's ring has eight sensors, each kind of it or none. */
static void see(const struct vs_driver_report *report, struct vs_base_reading *reading)
{
    reading->blind = report->rays[0] == 0 && report->rays[1] == 0;
    memset(reading->prox, 0, sizeof reading->prox);
    memset(reading->light, 0, sizeof reading->light);
    memcpy(reading->prox, report->prox,
           (size_t)(report->rays[0] < RING ? report->rays[0] : RING) * sizeof *report->prox);
    memcpy(reading->light, report->light,
           (size_t)(report->rays[1] < RING ? report->rays[1] : RING) * sizeof *report->light);
}

static void read_report(struct exec *e, const struct vs_driver_report *report,
                        struct vs_base_reading *reading)
{
    uint64_t age_ns = vs_driver_clock_ns() - report->measured_ns;
    int i;

    see(report, reading);
    if (report->flags & VS_DRIVER_WAY)
        count(e, report, reading);
    if (report->flags & VS_DRIVER_ACCELERATION)
        vs_base_feel(report->acceleration, NULL, 0, reading);
    reading->has_ground = (report->flags & VS_DRIVER_GROUND) != 0;
    reading->has_rates = (report->flags & VS_DRIVER_RATES) != 0;
    reading->has_distance = (report->flags & VS_DRIVER_DISTANCE) != 0;
    reading->distance_mm = report->distance_mm;
    memcpy(reading->ground, report->ground, sizeof reading->ground);
    for (i = 0; i < 3; i++)
        reading->rates[i] = limited(report->rates_mrad_s[i] * EPUCK_IMU_DIGITS / 1000);
    reading->battery_mv = report->battery_mv;
    reading->battery_low = report->battery_low;
    reading->rgb_leds = report->rgb_leds;
    reading->age_us = age_ns < VS_NEVER_US * UINT64_C(1000) ? (uint32_t)(age_ns / 1000)
                                                           : VS_NEVER_US;
    if (report->max_mm_s > 0)
        e->body.max_steps_s = limited(report->max_mm_s * 1e6 / e->body.step_nm);
}

/* Sends an order and waits for a report that follows it. Nothing in *reading is changed unless the
 * result is VS_OK. */
static int talk(struct vs_base *base, const struct vs_base_command *command, uint32_t flags,
                struct vs_base_reading *reading)
{
    struct exec *e = of(base);
    struct vs_driver *driver = e->line.driver;
    uint64_t deadline_ns = vs_posix_now_ns() + VS_BASE_EXCHANGE_NS;
    struct vs_driver_report report;
    int heard = hear(base, &report);
    int err = heard;

    if (heard != VS_OK && heard != VS_ERR_BUSY)
        return heard;
    if (is_late(driver))
        return fail(base, VS_ERR_SILENT, "the driver is late or silent: starting another");
    send_order(base, command, flags);
    while (driver->order_ns < driver->sent_ns &&
           vs_posix_wait(e->line.own, POLLIN, deadline_ns) == VS_OK) {
        err = hear(base, &report);
        if (err != VS_OK && err != VS_ERR_BUSY)
            return err;
        heard = err == VS_OK ? VS_OK : heard;
    }
    if (heard != VS_OK || driver->order_ns < driver->rest_ns)
        return VS_ERR_LATE;
    read_report(e, &report, reading);
    return VS_OK;
}

/* The next driver is to be started, unless it is too soon for that. */
static int start(struct vs_base *base)
{
    struct exec *e = of(base);
    struct vs_driver *driver = e->line.driver;
    uint64_t now_ns = vs_posix_now_ns();
    uint64_t again_ns = driver->started_ns + VS_DRIVER_AGAIN_NS;

    if (driver->started_ns != 0 && now_ns < again_ns) {
        uint64_t breath_ns = now_ns + VS_BASE_EXCHANGE_NS;

        (void)vs_posix_wait(e->line.own, 0, again_ns < breath_ns ? again_ns : breath_ns);
        return VS_ERR_BUSY;
    }
    return vs_driver_start(&e->line, now_ns) == VS_OK ? VS_ERR_BUSY : VS_ERR_IO;
}

static int recover_exec(struct vs_base *base)
{
    static const struct vs_base_command rest;
    struct exec *e = of(base);
    int before = e->line.driver->pid;
    struct vs_base_reading reading;
    int err;

    if (!runs(base))
        return before != 0 ? VS_ERR_SILENT : start(base);
    if (e->line.driver->killed_ns != 0)
        return VS_ERR_BUSY;
    err = talk(base, &rest, 0, &reading);
    if (err == VS_OK && e->troubled) {
        base->news = "the driver answers again";
        e->troubled = 0;
    }
    return err == VS_ERR_LATE ? VS_ERR_BUSY : err;
}

static int exchange_exec(struct vs_base *base, const struct vs_base_command *command,
                         struct vs_base_reading *reading)
{
    return runs(base) ? talk(base, command, 0, reading) : VS_ERR_SILENT;
}

/* One that has ended in order, as it was told, has stopped its robot. */
static int close_exec(struct vs_base *base)
{
    static const struct vs_base_command rest;
    struct vs_driver *driver = of(base)->line.driver;
    struct vs_base_reading reading;
    int before = driver->pid;
    int err;

    if (!runs(base)) {
        base->news = NULL;
        return before != 0 && driver->how == 0 ? VS_OK : VS_ERR_SILENT;
    }
    err = talk(base, &rest, VS_DRIVER_END, &reading);
    return err == VS_ERR_LATE ? VS_ERR_BUSY : err;
}

static const struct vs_base_choice choices[] = {{NULL, NULL}};

const struct vs_base_ops vs_base_exec = {
    "exec",
    "exec:COMMAND  a robot that a program of any language drives: DRIVERS.md",
    "python3 /usr/local/lib/vsense/mine.py",
    0,
    choices,
    open_exec,
    recover_exec,
    exchange_exec,
    close_exec,
};
