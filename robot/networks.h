/* SPDX-License-Identifier: MIT */
/* networks.h - the board's networks: who they are, and what Linux tells of them. */
#ifndef VS_NETWORKS_H
#define VS_NETWORKS_H

#include <stddef.h>
#include <stdint.h>
#include <sys/socket.h>

#define VS_NETWORK_NAME 16 /* of a network, the zero behind it included */

/* What those ioctls read and write: linux/if.h's struct ifreq and linux/wireless.h's struct
 * iwreq, as far as it matters here. */
struct vs_network {
    char name[VS_NETWORK_NAME];
    union {
        struct sockaddr address;
        struct { /* struct iw_param */
            int32_t value;
            uint8_t fixed;
            uint8_t disabled;
            uint16_t flags;
        } wireless;
        char room[24];
    } is;
};

/* Reads a file's beginning as text. Returns its length, 0 if it cannot be read. */
size_t vs_networks_read(const char *path, char *text, size_t size);

/* Goes through the lines "  eth0: ..." of /proc/net/dev and its like: *name is the next one's name,
 * of that length and with the colon behind it. Returns 0, and *len 0, at the text's end. */
int vs_networks_next(const char **name, size_t *len);

/* One ioctl. 0, or -1 if there is no such network or it does not know. */
int vs_networks_ask(int fd, unsigned int what, const char *name, size_t len,
                    struct vs_network *network);

#endif
