/* SPDX-License-Identifier: MIT */
/*
 * watchdog.h on devices that this machine may not open: its system calls are replaced before
 * it is read. Expected: Documentation/watchdog/watchdog-api.rst of Linux: any byte feeds, a V
 * right before the end switches off, a second owner gets EBUSY.
 */
#include <errno.h>
#include <fcntl.h>
#include <linux/watchdog.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "check.h"

#define S UINT64_C(1000000000)

enum { DEVICE_FD = 9 };

static int fake_error; /* of open, 0: none */
static int is_file;
static int timeout_s;
static int closed;
static char fed[16];
static size_t count;
static char said[400];

static int fake_open(const char *path, int flags)
{
    CHECK(strcmp(path, "/dev/watchdog") == 0 && flags == (O_WRONLY | O_NONBLOCK));
    errno = fake_error;
    return fake_error != 0 ? -1 : DEVICE_FD;
}

static ssize_t fake_write(int fd, const char *byte)
{
    CHECK(fd == DEVICE_FD && !closed && count < sizeof fed);
    fed[count++] = *byte;
    return 1;
}

static int fake_ioctl(unsigned long request, const int *seconds)
{
    CHECK(request == WDIOC_SETTIMEOUT);
    timeout_s = *seconds;
    errno = EINVAL; /* as a driver with one time-out only */
    return -1;
}

/* A device for which a position means nothing. */
static long fake_lseek(int fd)
{
    CHECK(fd == DEVICE_FD);
    errno = ESPIPE;
    return is_file ? 0 : -1;
}

void vs_posix_keep_from_children(int fd)
{
    CHECK(fd == DEVICE_FD);
}

void vs_report(const char *format, ...) __attribute__((format(printf, 1, 2)));

void vs_report(const char *format, ...)
{
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(said, sizeof said, format, arguments);
    va_end(arguments);
}

const char *vs_trouble(int number);

const char *vs_trouble(int number)
{
    static char text[16];

    snprintf(text, sizeof text, "errno %d", number);
    return text;
}

#define open(path, flags) fake_open(path, flags)
#define write(fd, byte, len) fake_write(fd, byte)
#define ioctl(fd, request, argument) ((void)(fd), fake_ioctl((unsigned long)(request), argument))
#define close(fd) ((void)(fd), closed++)
#define lseek(fd, at, whence) ((void)(at), (void)(whence), fake_lseek(fd))
#include "../../robot/watchdog.c"
#undef open
#undef write
#undef ioctl
#undef close
#undef lseek

static void test_one_that_is_taken_is_told(void)
{
    fake_error = EBUSY;
    vs_watchdog_open("/dev/watchdog");
    CHECK(strcmp(said, "--watchdog /dev/watchdog: another program has it (systemd's"
                       " RuntimeWatchdogSec, or a watchdog daemon); going on without it") == 0);
    vs_watchdog_feed(5 * S);
    vs_watchdog_end(1);
    CHECK(count == 0 && closed == 0);
    fake_error = ENOENT;
    vs_watchdog_open("/dev/watchdog");
    vs_watchdog_open(NULL);
    CHECK(strstr(said, "errno 2; going on without it") != NULL);
}

/* A byte each second would destroy it. */
static void test_a_file_is_left_alone(void)
{
    fake_error = 0;
    is_file = 1;
    vs_watchdog_open("/dev/watchdog");
    CHECK(strcmp(said, "--watchdog /dev/watchdog: is no device; going on without it") == 0);
    vs_watchdog_feed(5 * S);
    vs_watchdog_end(1);
    CHECK(count == 0 && closed == 1);
    is_file = closed = 0;
}

static void test_fed_once_a_second_and_closed(void)
{
    uint64_t now_ns;

    fake_error = 0;
    said[0] = '\0';
    vs_watchdog_open("/dev/watchdog");
    CHECK(said[0] == '\0' && timeout_s == 10);
    for (now_ns = 100 * S; now_ns < 105 * S; now_ns += S / 20)
        vs_watchdog_feed(now_ns);
    vs_watchdog_end(0);
    CHECK(count == 5 && memchr(fed, 'V', count) == NULL && closed == 0);
    vs_watchdog_end(1);
    vs_watchdog_end(1);
    vs_watchdog_feed(200 * S);
    CHECK(count == 6 && fed[5] == 'V' && closed == 1);
}

int main(void)
{
    test_one_that_is_taken_is_told();
    test_a_file_is_left_alone();
    test_fed_once_a_second_and_closed();
    return 0;
}
