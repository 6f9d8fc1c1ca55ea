/* SPDX-License-Identifier: MIT */
/*
 * base_reset.h on boards that have this and lack that: its system calls are replaced before it
 * is read. Expected: what Linux documents of its files and requests (Documentation/admin-guide/
 * gpio/sysfs.rst, include/uapi/linux/gpio.h), and the pulse that York's programs give.
 */
#include <errno.h>
#include <fcntl.h>
#include <linux/gpio.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "check.h"
#include "vs_err.h"

#define MS UINT64_C(1000000)

enum { FILES = 4, LINE_FD = 20, CHIP_FD = 21, FIRST_FD = 10 };

static const char *const paths[FILES] = {
    "/sys/class/gpio/export", "/sys/class/gpio/gpio24/direction", "/sys/class/gpio/gpio24/value",
    "/run/reset/value"};
static char contents[FILES][16];
static int has_sysfs;
static int has_numbers; /* 0: those of this board begin at 512, as from Linux 6.6 on */
static int exported;
static int has_chip;
static int is_taken;  /* the line is */
static int pin;       /* its level, -1: nobody drives it */
static uint32_t asked;
static uint64_t slept_ns;

static int fake_open(const char *path)
{
    int i;

    errno = ENOENT;
    if (strcmp(path, "/dev/gpiochip0") == 0)
        return has_chip ? CHIP_FD : -1;
    for (i = 0; i < FILES; i++)
        if (strcmp(path, paths[i]) == 0)
            return has_sysfs && (i == 0 || exported) ? FIRST_FD + i : -1;
    return strcmp(path, "/run/reset/direction") == 0 ? FIRST_FD + 1 : -1;
}

static ssize_t fake_write(int fd, const char *word, size_t len)
{
    int file = fd - FIRST_FD;

    memset(contents[file], 0, sizeof contents[file]);
    memcpy(contents[file], word, len);
    if (file == 0 && !has_numbers) {
        errno = EINVAL;
        return -1;
    }
    if (file == 0)
        exported = 1;
    else if (file == 1)
        pin = strcmp(contents[1], "high") == 0;
    else
        pin = contents[file][0] == '1';
    return (ssize_t)len;
}

static int fake_ioctl(int fd, unsigned long request, void *argument)
{
    struct gpio_v2_line_request *line = argument;
    const struct gpio_v2_line_values *values = argument;

    if (fd == LINE_FD) {
        CHECK(request == GPIO_V2_LINE_SET_VALUES_IOCTL && values->mask == 1);
        pin = (int)values->bits;
        return 0;
    }
    CHECK(fd == CHIP_FD && request == GPIO_V2_GET_LINE_IOCTL && line->num_lines == 1);
    CHECK(line->config.flags == GPIO_V2_LINE_FLAG_OUTPUT && line->config.num_attrs == 1);
    CHECK(line->config.attrs[0].attr.id == GPIO_V2_LINE_ATTR_ID_OUTPUT_VALUES);
    errno = EBUSY;
    if (is_taken)
        return -1;
    asked = line->offsets[0];
    pin = (int)(line->config.attrs[0].attr.values & line->config.attrs[0].mask);
    line->fd = LINE_FD;
    return 0;
}

uint64_t vs_posix_now_ns(void)
{
    return 1;
}

void vs_posix_keep_from_children(int fd)
{
    CHECK(fd >= FIRST_FD);
}

#define open(path, flags) fake_open(path)
#define write(fd, word, len) fake_write(fd, word, len)
#define pwrite(fd, word, len, at) fake_write(fd, word, (size_t)(len) + (size_t)(at))
#define ioctl(fd, request, argument) fake_ioctl(fd, (unsigned long)(request), argument)
#define close(fd) ((void)(fd))
#define poll(fds, count, ms) ((void)(fds), slept_ns += (uint64_t)(ms) * MS)
#include "../../robot/base_reset.c"
#undef open
#undef write
#undef pwrite
#undef ioctl
#undef close
#undef poll

static void begin(int sysfs, int numbers, int chip)
{
    memset(contents, 0, sizeof contents);
    has_sysfs = sysfs;
    has_numbers = numbers;
    has_chip = chip;
    exported = is_taken = 0;
    asked = 0;
    slept_ns = 0;
    pin = -1;
}

/* Low for 100 ms as python-library/pipuck/epuck.py:49-52 of yorkrobotlab/pi-puck has it, and no
 * wait longer than 20 ms; not again before the robot could have booted. */
static void check_pulse(struct vs_reset *reset)
{
    uint64_t began_ns = 1000 * MS;
    uint64_t waited_ns = slept_ns;

    CHECK(pin == 1 && !vs_reset_lasts(reset, began_ns));
    CHECK(vs_reset_begin(reset, began_ns) && pin == 0);
    while (vs_reset_lasts(reset, began_ns + slept_ns - waited_ns))
        CHECK(pin == 0);
    CHECK(pin == 1 && slept_ns - waited_ns == 100 * MS);
    CHECK(!vs_reset_begin(reset, began_ns + 4999 * MS) && pin == 1);
    CHECK(vs_reset_begin(reset, began_ns + 5000 * MS) && pin == 0);
}

static void test_sysfs(void)
{
    struct vs_reset reset = {0};

    begin(1, 1, 1);
    CHECK(vs_reset_open(&reset, "24") == VS_OK);
    CHECK(strcmp(contents[0], "24") == 0 && strcmp(contents[1], "high") == 0 && asked == 0);
    check_pulse(&reset);
    begin(1, 1, 0);
    exported = 1;
    CHECK(vs_reset_open(&reset, "24") == VS_OK && contents[0][0] == '\0');
}

static void test_folder(void)
{
    struct vs_reset reset = {0};

    begin(1, 0, 0);
    exported = 1;
    CHECK(vs_reset_open(&reset, "/run/reset") == VS_OK);
    check_pulse(&reset);
    CHECK(vs_reset_open(&reset, "/run/nothing") == VS_ERR_IO && errno == ENOENT);
}

/* Where sysfs is gone, and where its numbers are others. */
static void test_character_device(int sysfs)
{
    struct vs_reset reset = {0};

    begin(sysfs, 0, 1);
    CHECK(vs_reset_open(&reset, "24") == VS_OK && asked == 24);
    check_pulse(&reset);
    is_taken = 1;
    CHECK(vs_reset_open(&reset, "24") == VS_ERR_IO && errno == EBUSY);
    CHECK(!vs_reset_begin(&reset, 9000000u * (uint64_t)MS));
    has_chip = 0;
    CHECK(vs_reset_open(&reset, "24") == VS_ERR_IO && errno == ENOENT);
}

int main(void)
{
    struct vs_reset none = {0};

    test_sysfs();
    test_folder();
    test_character_device(0);
    test_character_device(1);
    pin = -1;
    CHECK(!vs_reset_begin(&none, 5) && !vs_reset_lasts(&none, 5) && pin == -1);
    return 0;
}
