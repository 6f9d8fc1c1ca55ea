/* SPDX-License-Identifier: MIT */
#include "wifi_line.h"

#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "../c_src/vs_posix.h"

int vs_wifi_line_open(const uint8_t address[4], uint16_t port, int *fd)
{
    struct sockaddr_in robot;
    int at_once = 1;
    int opened = socket(AF_INET, SOCK_STREAM, 0);

    if (opened < 0)
        return VS_ERR_IO;
    memset(&robot, 0, sizeof robot);
    robot.sin_family = AF_INET;
    robot.sin_port = htons(port);
    memcpy(&robot.sin_addr, address, 4);
    vs_posix_keep_from_children(opened);
    fcntl(opened, F_SETFL, O_NONBLOCK);
    (void)setsockopt(opened, IPPROTO_TCP, TCP_NODELAY, &at_once, sizeof at_once);
    if (connect(opened, (const struct sockaddr *)&robot, sizeof robot) != 0 &&
        errno != EINPROGRESS) {
        int why = errno;

        close(opened);
        errno = why;
        return VS_ERR_IO;
    }
    *fd = opened;
    return VS_OK;
}

int vs_wifi_line_await(int fd, uint64_t deadline_ns)
{
    socklen_t size = sizeof errno;
    int why = 0;
    int err = vs_posix_wait(fd, POLLOUT, deadline_ns);

    if (err == VS_ERR_BUSY)
        return err;
    if (getsockopt(fd, SOL_SOCKET, SO_ERROR, &why, &size) != 0)
        why = errno;
    errno = why;
    return why == 0 && err == VS_OK ? VS_OK : VS_ERR_IO;
}

void vs_wifi_line_close(int *fd)
{
    if (*fd < 0)
        return;
    (void)shutdown(*fd, SHUT_RDWR);
    close(*fd);
    *fd = -1;
}

int vs_wifi_line_unheard(int fd)
{
    int bytes = 0;

    return ioctl(fd, TIOCOUTQ, &bytes) == 0 ? bytes : -1;
}

static uint64_t io_now_ns(void *context)
{
    (void)context;
    return vs_posix_recent_ns();
}

static int io_read(void *context, uint8_t *buf, size_t cap, uint64_t deadline_ns)
{
    int fd = *(const int *)context;
    int err = vs_posix_wait(fd, POLLIN, deadline_ns);
    ssize_t len;

    if (err != VS_OK)
        return err == VS_ERR_BUSY ? 0 : err;
    len = recv(fd, buf, cap, MSG_DONTWAIT);
    if (len > 0)
        return (int)len;
    if (len < 0 && (errno == EAGAIN || errno == EINTR))
        return 0;
    return len == 0 ? VS_ERR_HANGUP : VS_ERR_IO;
}

/* A command is whole, or the connection is of no use any more. */
static int io_write(void *context, const uint8_t *buf, size_t len, uint64_t deadline_ns)
{
    ssize_t sent = send(*(const int *)context, buf, len, MSG_NOSIGNAL | MSG_DONTWAIT);

    (void)deadline_ns; /* its buffer takes a thousand of them */
    return sent == (ssize_t)len ? VS_OK : VS_ERR_IO;
}

void vs_wifi_line_io(struct vs_io *io, int *fd)
{
    io->context = fd;
    io->now_ns = io_now_ns;
    io->read = io_read;
    io->write = io_write;
    io->expect = NULL;
}
