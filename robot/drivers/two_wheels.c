/* SPDX-License-Identifier: MIT */
/*
 * two_wheels.c - a driver in C, from which to begin: a robot with two wheels and a lamp behind a
 * serial line. "left right lamp\n", in mm/s, sets them, and "ok\n" is the answer. It measures
 * nothing. cc -o two_wheels two_wheels.c; vsensed --base "exec:/usr/local/bin/two_wheels DEVICE"
 */
#define _POSIX_C_SOURCE 200809L

#include <fcntl.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum { ORDER = 48, REPORT = 160, MAX_MM_S = 200, FLAG_END = 1, BATTERY_UNKNOWN = 255 };

static uint64_t load(const uint8_t *at, int bytes)
{
    uint64_t value = 0;

    while (bytes-- > 0)
        value = value << 8 | at[bytes];
    return value;
}

static void store(uint8_t *at, uint64_t value, int bytes)
{
    for (; bytes > 0; bytes--, value >>= 8)
        *at++ = (uint8_t)value;
}

static uint64_t now_ns(void)
{
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

/* 1: the robot has answered. */
static int drive(int robot, int left_um_s, int right_um_s, int lamp)
{
    struct pollfd line = {robot, POLLIN, 0};
    char text[40];
    int len = snprintf(text, sizeof text, "%d %d %d\n", left_um_s / 1000, right_um_s / 1000, lamp);

    if (write(robot, text, (size_t)len) != len)
        return 0;
    while (poll(&line, 1, 25) > 0 && read(robot, text, 1) == 1)
        if (text[0] == '\n')
            return 1;
    return 0;
}

/* Follows the newest order of those that are there. Returns until when, 0: to the next one, or -1:
 * the end. */
static int64_t follow(int robot)
{
    uint8_t orders[64 * ORDER], report[REPORT] = {'v', 's', 'd', 1};
    ssize_t len = read(STDIN_FILENO, orders, sizeof orders);
    const uint8_t *order = orders + len - ORDER;
    int32_t left, right;

    if (len < ORDER || memcmp(order, report, 4) != 0)
        return -1;
    left = (int32_t)load(order + 24, 4);
    right = (int32_t)load(order + 28, 4);
    if (drive(robot, left, right, load(order + 32, 2) != 0)) {
        store(report + 8, load(order + 8, 8), 8); /* which order it follows */
        store(report + 16, now_ns(), 8);
        store(report + 40, MAX_MM_S, 2);
        store(report + 44, BATTERY_UNKNOWN, 1);
        if (write(STDOUT_FILENO, report, sizeof report) != (ssize_t)sizeof report)
            return -1;
    }
    if (load(order + 4, 4) & FLAG_END)
        return -1;
    return left == 0 && right == 0 ? 0 : (int64_t)load(order + 16, 8);
}

int main(int argc, char *argv[])
{
    int robot = open(argc > 1 ? argv[1] : "", O_RDWR | O_NOCTTY);
    struct pollfd orders = {STDIN_FILENO, POLLIN, 0};
    int64_t until_ns = 0;

    while (robot >= 0 && until_ns >= 0) {
        int64_t left_ms = (until_ns - (int64_t)now_ns()) / 1000000;

        if (poll(&orders, 1, until_ns == 0 ? -1 : left_ms > 0 ? (int)left_ms : 0) > 0)
            until_ns = follow(robot);
        else if (drive(robot, 0, 0, 0))
            until_ns = 0; /* nobody said to go on */
    }
    return robot < 0 || !drive(robot, 0, 0, 0);
}
