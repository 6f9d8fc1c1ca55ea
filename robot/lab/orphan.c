/* SPDX-License-Identifier: MIT */
/*
 * orphan.c - part of daemons that are built for the lab, on this machine, and of no robot's: one
 * whose standard input is a pipe is asked to end when that ends. The other end is of who started
 * it, and ends however that did. A guard that takes a hung worker's place is nobody's child any
 * more, and asked all the same.
 */
#define _GNU_SOURCE
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#if defined(__linux__)
__attribute__((constructor)) static void tie(void)
{
    struct pollfd ended = {-1, POLLIN, 0};
    struct stat input;

    if (fstat(STDIN_FILENO, &input) != 0 || !S_ISFIFO(input.st_mode))
        return;
    /* opened anew: who is told belongs to an open file, which others here share */
    ended.fd = open("/proc/self/fd/0", O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (ended.fd < 0 || fcntl(ended.fd, F_SETOWN, getpid()) != 0 ||
        fcntl(ended.fd, F_SETSIG, SIGTERM) != 0 ||
        fcntl(ended.fd, F_SETFL, O_NONBLOCK | O_ASYNC) != 0)
        return;
    if (poll(&ended, 1, 0) != 0) /* before it was watched */
        raise(SIGTERM);
}
#endif
