/* SPDX-License-Identifier: MIT */
#include "vs_i2c_posix.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/i2c-dev.h>
#include <linux/i2c.h>
#include <poll.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "vs_format.h"
#include "vs_posix.h"

#define TIMEOUT_UNIT_NS 10000000u /* [ns] of ioctl I2C_TIMEOUT */
#define ADAPTERS_MAX 4            /* a bus behind multiplexers behind each other */
#define RETRY_MS 20
#define REQUEST_HEADER 6          /* [byte] number u32, address, bytes to read */
#define REPLY_HEADER 5            /* [byte] number u32, 0 = acknowledged */

static uint64_t bus_now_ns(void *context)
{
    (void)context;
    return vs_posix_recent_ns();
}

static int transfer_device(void *context, uint8_t address, const uint8_t *out, size_t out_len,
                           uint8_t *in, size_t in_len)
{
    uint8_t copy[VS_I2C_OUT_MAX]; /* the kernel's struct wants what it writes to be mutable */
    struct i2c_msg messages[2];
    struct i2c_rdwr_ioctl_data transaction = {messages, 0};
    int done;
    int why;

    if (out_len > sizeof copy || in_len > VS_I2C_IN_MAX || out_len + in_len == 0)
        return VS_ERR_ARGUMENT;
    memset(messages, 0, sizeof messages);
    if (out_len > 0) {
        memcpy(copy, out, out_len);
        messages[0].buf = copy;
        messages[0].len = (uint16_t)out_len;
        transaction.nmsgs++;
    }
    if (in_len > 0) {
        messages[transaction.nmsgs].flags = I2C_M_RD;
        messages[transaction.nmsgs].buf = in;
        messages[transaction.nmsgs].len = (uint16_t)in_len;
        transaction.nmsgs++;
    }
    messages[0].addr = messages[1].addr = address;
    done = ioctl(*(const int *)context, I2C_RDWR, &transaction);
    why = errno;
    (void)vs_posix_now_ns(); /* the bus took its time */
    if (done == (int)transaction.nmsgs)
        return VS_OK;
    if (why == ENODEV)
        return VS_ERR_HANGUP;
    return why == EBADF || why == EINVAL || why == EFAULT ? VS_ERR_IO : VS_ERR_SILENT;
}

static void put_u32(uint8_t *at, uint32_t value)
{
    int i;

    for (i = 0; i < 4; i++, value >>= 8)
        at[i] = (uint8_t)value;
}

/* Reads replies until that of our request comes: earlier ones are those of requests
 * that timed out, maybe of another process that had this socket before. */
static int receive(int fd, const uint8_t *number, uint8_t *in, size_t in_len, uint64_t deadline_ns)
{
    uint8_t reply[REPLY_HEADER + VS_I2C_IN_MAX];

    for (;;) {
        int err = vs_posix_wait(fd, POLLIN, deadline_ns);
        ssize_t len;

        if (err != VS_OK)
            return err == VS_ERR_BUSY ? VS_ERR_SILENT : err;
        len = recv(fd, reply, sizeof reply, MSG_DONTWAIT);
        if (len == 0 || (len < 0 && errno != EAGAIN && errno != EINTR))
            return VS_ERR_HANGUP;
        if (len < REPLY_HEADER || memcmp(reply, number, 4) != 0)
            continue;
        if (reply[4] != 0)
            return VS_ERR_SILENT;
        if ((size_t)len != REPLY_HEADER + in_len)
            return VS_ERR_IO;
        memcpy(in, reply + REPLY_HEADER, in_len);
        return VS_OK;
    }
}

static int transfer_socket(void *context, uint8_t address, const uint8_t *out, size_t out_len,
                           uint8_t *in, size_t in_len)
{
    uint8_t request[REQUEST_HEADER + VS_I2C_OUT_MAX];
    int fd = *(const int *)context;
    uint64_t now_ns = vs_posix_now_ns();
    uint8_t none;

    if (out_len > VS_I2C_OUT_MAX || in_len > VS_I2C_IN_MAX || out_len + in_len == 0)
        return VS_ERR_ARGUMENT;
    put_u32(request, (uint32_t)now_ns); /* no two requests begin in the same nanosecond */
    request[4] = address;
    request[5] = (uint8_t)in_len;
    if (out_len > 0)
        memcpy(request + REQUEST_HEADER, out, out_len);
    if (send(fd, request, REQUEST_HEADER + out_len, MSG_NOSIGNAL | MSG_DONTWAIT) < 0)
        return errno == EAGAIN || errno == EINTR ? VS_ERR_SILENT : VS_ERR_HANGUP;
    return receive(fd, request, in_len > 0 ? in : &none, in_len, now_ns + VS_I2C_TIMEOUT_NS);
}

/* The other end greets with one packet when it is free. */
static int await_greeting(int fd, uint64_t until_ns)
{
    uint8_t greeting;
    int err = vs_posix_wait(fd, POLLIN, until_ns);

    if (err == VS_ERR_BUSY)
        return VS_ERR_LOCKED;
    if (err == VS_OK && recv(fd, &greeting, 1, MSG_DONTWAIT) > 0)
        return VS_OK;
    errno = ECONNRESET;
    return VS_ERR_IO;
}

static int connect_bus(int fd, const char *path, uint64_t until_ns)
{
    struct sockaddr_un name;

    memset(&name, 0, sizeof name);
    name.sun_family = AF_UNIX;
    if (strlen(path) >= sizeof name.sun_path) {
        errno = ENAMETOOLONG;
        return VS_ERR_IO;
    }
    memcpy(name.sun_path, path, strlen(path));
    while (connect(fd, (const struct sockaddr *)&name, sizeof name) != 0) {
        if (errno != EAGAIN && errno != EINTR)
            return VS_ERR_IO;
        if (vs_posix_now_ns() >= until_ns)
            return VS_ERR_LOCKED;
        poll(NULL, 0, RETRY_MS);
    }
    return await_greeting(fd, until_ns);
}

/* The first number in the name that a link points to, -1 if there is no such link. */
static int number_behind(const char *link)
{
    char target[256];
    ssize_t len = readlink(link, target, sizeof target - 1);
    const char *at = target;
    const char *name = target;
    int number = 0;

    if (len < 0)
        return -1;
    target[len] = '\0';
    for (; *at != '\0'; at++)
        if (*at == '/')
            name = at + 1;
    if (strncmp(name, "i2c-", 4) == 0)
        name += 4;
    for (; *name >= '0' && *name <= '9'; name++)
        number = number * 10 + (*name - '0');
    return number;
}

/* Number of an open adapter, whatever name it was opened by. */
static int number_of(int fd)
{
    char link[32];

    vs_format(link, sizeof link, "/proc/self/fd/%d", fd);
    return number_behind(link);
}

/* Number of the adapter that a multiplexer's channel hangs on, -1 if it is none. */
static int parent_of(int number)
{
    char link[64];

    /* the multiplexer's name: "1-0070", adapter and address */
    vs_format(link, sizeof link, "/sys/bus/i2c/devices/i2c-%d/mux_device", number);
    return number_behind(link);
}

/* Errors of the bus block for as long as its adapter's time-out says: a whole second,
 * unless told otherwise. It can be set on the adapter of the wires only. */
static int bound_errors(int fd)
{
    char path[32];
    int parent;
    int err;
    int i;

    if (ioctl(fd, I2C_TIMEOUT, (unsigned long)(VS_I2C_TIMEOUT_NS / TIMEOUT_UNIT_NS)) != 0)
        return -1;
    parent = parent_of(number_of(fd));
    for (i = 0; i < ADAPTERS_MAX && parent >= 0; i++) {
        vs_format(path, sizeof path, "/dev/i2c-%d", parent);
        fd = open(path, O_RDWR);
        if (fd < 0)
            return -1;
        err = ioctl(fd, I2C_TIMEOUT, (unsigned long)(VS_I2C_TIMEOUT_NS / TIMEOUT_UNIT_NS));
        close(fd);
        if (err != 0)
            return -1;
        parent = parent_of(parent);
    }
    return 0;
}

static int open_device(int fd, uint64_t wait_ns)
{
    unsigned long functions = 0;
    int err = vs_posix_lock(fd, wait_ns);

    if (err != VS_OK)
        return err;
    if (ioctl(fd, I2C_FUNCS, &functions) != 0)
        return VS_ERR_IO;
    if ((functions & I2C_FUNC_I2C) == 0) {
        errno = EOPNOTSUPP;
        return VS_ERR_IO;
    }
    return bound_errors(fd) == 0 ? VS_OK : VS_ERR_IO;
}

int vs_i2c_is_socket(const char *path)
{
    return strncmp(path, VS_I2C_UNIX, strlen(VS_I2C_UNIX)) == 0;
}

int vs_i2c_open(struct vs_i2c *bus, const char *path, uint64_t wait_ns, int *fd)
{
    size_t prefix = strlen(VS_I2C_UNIX);
    int is_socket = vs_i2c_is_socket(path);
    int opened = is_socket ? socket(AF_UNIX, SOCK_SEQPACKET, 0) : open(path, O_RDWR);
    int err;
    int why;

    if (opened < 0)
        return VS_ERR_IO;
    vs_posix_keep_from_children(opened);
    if (!is_socket)
        err = open_device(opened, wait_ns);
    else if (fcntl(opened, F_SETFL, O_NONBLOCK) != 0)
        err = VS_ERR_IO;
    else
        err = connect_bus(opened, path + prefix, vs_posix_now_ns() + wait_ns);
    if (err != VS_OK) {
        why = errno;
        close(opened);
        errno = why;
        return err;
    }
    *fd = opened;
    bus->context = fd;
    bus->now_ns = bus_now_ns;
    bus->transfer = is_socket ? transfer_socket : transfer_device;
    return VS_OK;
}
