/* SPDX-License-Identifier: MIT */
/*
 * The POSIX edge of the I2C bus on adapters that are not there: its system calls are
 * replaced before it is read. What the kernel is asked for, and what its errors mean.
 */
#include <errno.h>
#include <fcntl.h>
#include <linux/i2c-dev.h>
#include <linux/i2c.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "check.h"
#include "vs_err.h"
#include "vs_posix.h"

#define DEVICE_FD 7
#define PARENT_FD 8 /* and above: a parent, its parent, .. */

static int fake_error;          /* errno of a transaction, 0 = it goes well */
static unsigned long abilities; /* of the adapter */
static int parents;             /* multiplexers before it */
static int timeouts;            /* adapters whose time-out was set to 20 ms */
static int denied;              /* the parent cannot be opened */
static struct i2c_msg seen[2];
static uint8_t written[64];
static uint32_t asked;

static int transact(const struct i2c_rdwr_ioctl_data *transaction)
{
    uint32_t i;

    asked = transaction->nmsgs;
    for (i = 0; i < asked; i++) {
        seen[i] = transaction->msgs[i];
        if (seen[i].flags & I2C_M_RD)
            memset(seen[i].buf, 0x5A, seen[i].len);
        else
            memcpy(written, seen[i].buf, seen[i].len);
    }
    errno = fake_error;
    return fake_error != 0 ? -1 : (int)asked;
}

static int fake_ioctl(unsigned long request, uintptr_t argument)
{
    if (request == I2C_RDWR)
        return transact((const struct i2c_rdwr_ioctl_data *)argument);
    if (request == I2C_FUNCS)
        *(unsigned long *)argument = abilities;
    else if (request == I2C_TIMEOUT)
        timeouts += argument == 2;
    return 0;
}

static int fake_open(const char *path)
{
    int number = atoi(path + strlen("/dev/i2c-"));

    if (number == 12)
        return DEVICE_FD;
    CHECK(number >= 1 && number <= parents);
    errno = EACCES;
    return denied ? -1 : PARENT_FD + number;
}

/* i2c-12 hangs on a multiplexer of i2c-1, that on one of i2c-2, .. */
static ssize_t fake_readlink(const char *path, char *target, size_t size)
{
    const char *prefix = "/sys/bus/i2c/devices/i2c-";
    int number = strncmp(path, prefix, strlen(prefix)) == 0 ? atoi(path + strlen(prefix)) : -1;
    int parent = number == 12 ? 1 : number + 1;

    if (strcmp(path, "/proc/self/fd/7") == 0)
        return snprintf(target, size, "/dev/i2c-12");
    if (parent > parents)
        return -1;
    snprintf(target, size, "../../i2c-%d/%d-0070", parent, parent);
    return (ssize_t)strlen(target);
}

int vs_posix_lock(int fd, uint64_t wait_ns)
{
    CHECK(fd == DEVICE_FD && wait_ns == 5);
    return VS_OK;
}

int vs_posix_wait(int fd, short events, uint64_t deadline_ns)
{
    (void)fd;
    (void)events;
    (void)deadline_ns;
    return VS_ERR_BUSY;
}

uint64_t vs_posix_now_ns(void)
{
    return 1;
}

uint64_t vs_posix_recent_ns(void)
{
    return 1;
}

void vs_posix_keep_from_children(int fd)
{
    (void)fd;
}

static int closed;

#define ioctl(fd, request, argument) \
    ((void)(fd), fake_ioctl((unsigned long)(request), (uintptr_t)(argument)))
#define open(path, flags) fake_open(path)
#define readlink(path, target, size) fake_readlink(path, target, size)
#define close(fd) ((void)(fd), closed++)
#include "../../c_src/vs_i2c_posix.c"
#undef ioctl
#undef open
#undef readlink
#undef close

static void begin(void)
{
    abilities = I2C_FUNC_I2C;
    fake_error = parents = timeouts = denied = closed = 0;
}

static void test_errors_are_bounded_on_every_adapter(void)
{
    struct vs_i2c bus;
    int fd;

    for (begin(); parents < 4; parents++) {
        timeouts = closed = 0;
        CHECK(vs_i2c_open(&bus, "/dev/i2c-12", 5, &fd) == VS_OK && fd == DEVICE_FD);
        CHECK(timeouts == 1 + parents && closed == parents);
    }
    denied = 1;
    CHECK(vs_i2c_open(&bus, "/dev/i2c-12", 5, &fd) == VS_ERR_IO && errno == EACCES);
}

/* An adapter that only knows SMBus cannot do it. */
static void test_adapter_that_cannot(void)
{
    struct vs_i2c bus;
    int fd;

    begin();
    abilities = I2C_FUNC_SMBUS_BYTE_DATA;
    CHECK(vs_i2c_open(&bus, "/dev/i2c-12", 5, &fd) == VS_ERR_IO && errno == EOPNOTSUPP);
    CHECK(closed == 1);
}

static void test_transactions(void)
{
    static const uint8_t out[3] = {2, 0x9C, 0xFF};
    uint8_t in[4] = {0};
    struct vs_i2c bus;
    int fd;

    begin();
    CHECK(vs_i2c_open(&bus, "/dev/i2c-12", 5, &fd) == VS_OK);
    CHECK(bus.transfer(bus.context, 0x1F, out, 3, in, 4) == VS_OK);
    CHECK(asked == 2 && seen[0].addr == 0x1F && seen[1].addr == 0x1F);
    CHECK(seen[0].flags == 0 && seen[0].len == 3 && memcmp(written, out, 3) == 0);
    CHECK(seen[1].flags == I2C_M_RD && seen[1].len == 4 && in[3] == 0x5A);
    CHECK(bus.transfer(bus.context, 0x20, out, 2, NULL, 0) == VS_OK);
    CHECK(asked == 1 && seen[0].flags == 0 && seen[0].addr == 0x20);
    CHECK(bus.transfer(bus.context, 0x60, NULL, 0, in, 1) == VS_OK);
    CHECK(asked == 1 && seen[0].flags == I2C_M_RD && seen[0].len == 1);
    CHECK(bus.transfer(bus.context, 0x60, NULL, 0, NULL, 0) == VS_ERR_ARGUMENT);
    CHECK(bus.transfer(bus.context, 0x60, out, 33, NULL, 0) == VS_ERR_ARGUMENT);
    CHECK(bus.transfer(bus.context, 0x60, NULL, 0, in, 65) == VS_ERR_ARGUMENT);
}

static void test_what_errors_mean(void)
{
    static const struct {
        int error;
        int meaning;
    } cases[] = {{EREMOTEIO, VS_ERR_SILENT}, {ENXIO, VS_ERR_SILENT},   {ETIMEDOUT, VS_ERR_SILENT},
                 {EAGAIN, VS_ERR_SILENT},    {EIO, VS_ERR_SILENT},     {ENODEV, VS_ERR_HANGUP},
                 {EINVAL, VS_ERR_IO},        {EBADF, VS_ERR_IO}};
    uint8_t byte = 0;
    struct vs_i2c bus;
    size_t i;
    int fd;

    begin();
    CHECK(vs_i2c_open(&bus, "/dev/i2c-12", 5, &fd) == VS_OK);
    for (i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        fake_error = cases[i].error;
        CHECK(bus.transfer(bus.context, 0x1F, &byte, 1, &byte, 1) == cases[i].meaning);
    }
}

static void test_socket_that_is_not_there(void)
{
    struct vs_i2c bus;
    char path[200] = "unix:/";
    int fd;

    CHECK(vs_i2c_open(&bus, "unix:/nowhere/bus", 5, &fd) == VS_ERR_IO && errno == ENOENT);
    memset(path + 6, 'x', sizeof path - 7);
    CHECK(vs_i2c_open(&bus, path, 5, &fd) == VS_ERR_IO && errno == ENAMETOOLONG);
}

int main(void)
{
    test_errors_are_bounded_on_every_adapter();
    test_adapter_that_cannot();
    test_transactions();
    test_what_errors_mean();
    test_socket_that_is_not_there();
    return 0;
}
