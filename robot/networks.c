/* SPDX-License-Identifier: MIT */
#include "networks.h"

#include <fcntl.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

size_t vs_networks_read(const char *path, char *text, size_t size)
{
    int fd = open(path, O_RDONLY);
    size_t len = 0;
    ssize_t got = 0;

    while (fd >= 0 && len < size - 1 && (got = read(fd, text + len, size - 1 - len)) > 0)
        len += (size_t)got;
    if (fd >= 0)
        close(fd);
    text[len] = '\0';
    return len;
}

int vs_networks_next(const char **name, size_t *len)
{
    const char *at = *name + *len;

    do {
        at += strcspn(at, "\n");
        at += strspn(at, "\n ");
        *len = strcspn(at, ":\n");
    } while (at[*len] == '\n');
    *name = at;
    return at[*len] == ':';
}

int vs_networks_ask(int fd, unsigned int what, const char *name, size_t len,
                    struct vs_network *network)
{
    if (len == 0 || len >= sizeof network->name)
        return -1;
    memset(network, 0, sizeof *network);
    memcpy(network->name, name, len);
    return ioctl(fd, what, network) != 0 ? -1 : 0;
}
