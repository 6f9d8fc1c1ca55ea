/* SPDX-License-Identifier: MIT */
/*
 * calls.c - three system calls in place of the C library's. On a 32-bit board its own are 1.3 kB,
 * nearly all of it for times beyond 2038 on kernels that do not know them. The only time that is
 * handed to one of these is how long to wait, which the old form of the option can say, too.
 * Where the library has no such part this file is empty.
 */
#include <stdarg.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/time.h>

long syscall(long number, ...); /* no part of POSIX, so no header shows it */

#ifdef SYS_clock_gettime32
#define RECEIVE_WITHIN 20 /* SO_RCVTIMEO of all kernels, two longs; the library's is of 5.1 */

int ioctl(int fd, int request, ...)
{
    va_list more;
    void *argument;

    va_start(more, request);
    argument = va_arg(more, void *);
    va_end(more);
    return (int)syscall(SYS_ioctl, fd, request, argument);
}

int setsockopt(int fd, int level, int name, const void *value, socklen_t len)
{
    long wait[2];

    if (level == SOL_SOCKET && name == SO_RCVTIMEO) {
        const struct timeval *given = value;

        wait[0] = (long)given->tv_sec;
        wait[1] = (long)given->tv_usec;
        name = RECEIVE_WITHIN;
        value = wait;
        len = sizeof wait;
    }
    return (int)syscall(SYS_setsockopt, fd, level, name, value, len);
}

int getsockopt(int fd, int level, int name, void *restrict value, socklen_t *restrict len)
{
    return (int)syscall(SYS_getsockopt, fd, level, name, value, len);
}
#endif
