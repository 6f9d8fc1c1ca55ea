/* SPDX-License-Identifier: MIT */
/*
 * calls.c - three system calls in place of the C library's. On a 32-bit board its own are 1.3 kB,
 * nearly all of it for times beyond 2038 on kernels that do not know them. The one time that
 * is handed to these three is a wait, of a socket, and travels as all kernels know it. Where the
 * library has no such part this file is empty.
 */
#include <stdarg.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/time.h>

long syscall(long number, ...); /* no part of POSIX, so no header shows it */

#ifdef SYS_clock_gettime32
/* SO_RCVTIMEO_OLD of Linux, include/uapi/asm-generic/socket.h; ARM has no number of its own. The
 * C library's SO_RCVTIMEO came with Linux 5.1. */
enum { WAIT_AS_EVER = 20 };

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
    const struct timeval *wait = value;
    long old[2]; /* [s], [us] */

    if (level != SOL_SOCKET || name != SO_RCVTIMEO)
        return (int)syscall(SYS_setsockopt, fd, level, name, value, len);
    old[0] = (long)wait->tv_sec;
    old[1] = (long)wait->tv_usec;
    return (int)syscall(SYS_setsockopt, fd, level, WAIT_AS_EVER, old, sizeof old);
}

int getsockopt(int fd, int level, int name, void *restrict value, socklen_t *restrict len)
{
    return (int)syscall(SYS_getsockopt, fd, level, name, value, len);
}
#endif
