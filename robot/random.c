/* SPDX-License-Identifier: MIT */
#include "random.h"

#include <errno.h>
#include <fcntl.h>
#include <unistd.h>

int vs_random_fill(void *bytes, size_t len)
{
    int fd = open("/dev/urandom", O_RDONLY | O_CLOEXEC);
    ssize_t got;
    int why;

    if (fd < 0)
        return -1;
    do
        got = read(fd, bytes, len);
    while (got < 0 && errno == EINTR);
    why = got < 0 ? errno : EIO; /* the kernel gives up to 256 bytes whole */
    close(fd);
    errno = why;
    return got == (ssize_t)len ? 0 : -1;
}
