/* SPDX-License-Identifier: MIT */
#include "uid.h"

#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "networks.h"

#define DIGITS (2 * VS_UID_SIZE)
#define MAC_SIZE 6
#define SIOCGIFHWADDR_LINUX 0x8927 /* linux/sockios.h; musl and glibc show it beyond POSIX only */

enum { ETHERNET = 1, GIVEN_LOCALLY = 2 };

const char vs_uid_missing[] = "this board has no id, neither a machine-id, nor a serial number, nor "
                              "a MAC address: give --uid, 32 hexadecimal digits";

static int from_file(struct vs_options *options, const char *path)
{
    char text[DIGITS + 1];

    return vs_networks_read(path, text, sizeof text) == DIGITS &&
           strspn(text, "0") != DIGITS && vs_options_make_uid(options, text) == 0;
}

/* Writes bytes in hexadecimal, and no zero behind them. */
static void put_hex(const uint8_t *bytes, size_t count, char *digits)
{
    static const char hexadecimal[] = "0123456789abcdef";
    size_t i;

    for (i = 0; i < count; i++) {
        digits[2 * i] = hexadecimal[bytes[i] >> 4];
        digits[2 * i + 1] = hexadecimal[bytes[i] & 15];
    }
}

/* Digits that are too few for a uid: before them comes what they are, so that no number of one
 * kind is ever that of another. */
static int from_digits(struct vs_options *options, char kind, const char *digits, size_t count)
{
    char text[DIGITS + 1];

    memset(text, '0', DIGITS);
    text[4] = kind; /* the first four are mixed with the tag */
    memcpy(text + DIGITS - count, digits, count);
    text[DIGITS] = '\0';
    return vs_options_make_uid(options, text) == 0;
}

/* "Serial          : 00000000a1b2c3d4" */
static int from_serial(struct vs_options *options)
{
    static const char hexadecimal[] = "0123456789abcdefABCDEF";
    char text[4096];
    const char *at = text;
    size_t count;

    vs_networks_read("/proc/cpuinfo", text, sizeof text);
    while (*at != '\0' && strncmp(at, "Serial", 6) != 0) { /* strstr() has 1.4 kB */
        at += strcspn(at, "\n");
        at += strspn(at, "\n");
    }
    if (*at == '\0')
        return 0;
    at += strlen("Serial");
    at += strspn(at, " \t:");
    count = strspn(at, hexadecimal);
    if (strspn(at, "0") == count || count > DIGITS - 8)
        return 0;
    return from_digits(options, '1', at, count);
}

/* 1 and a network's address, if its maker gave it one. */
static int read_mac(int fd, const char *name, size_t len, uint8_t mac[MAC_SIZE])
{
    struct vs_network asked;

    if (vs_networks_ask(fd, SIOCGIFHWADDR_LINUX, name, len, &asked) != 0 ||
        asked.is.address.sa_family != ETHERNET)
        return 0;
    memcpy(mac, asked.is.address.sa_data, MAC_SIZE);
    return (mac[0] & GIVEN_LOCALLY) == 0 && (mac[0] | mac[1] | mac[2]) != 0;
}

/* Returns how many there are. */
static int find_lowest_mac(int fd, uint8_t lowest[MAC_SIZE])
{
    char text[4096];
    uint8_t mac[MAC_SIZE];
    const char *name = text;
    size_t len = 0;
    int found = 0;

    vs_networks_read("/proc/net/dev", text, sizeof text);
    while (vs_networks_next(&name, &len))
        if (read_mac(fd, name, len, mac) &&
            (found++ == 0 || memcmp(mac, lowest, MAC_SIZE) < 0))
            memcpy(lowest, mac, MAC_SIZE);
    return found;
}

static int from_mac(struct vs_options *options)
{
    uint8_t mac[MAC_SIZE];
    char digits[2 * MAC_SIZE];
    int fd = socket(AF_INET, SOCK_DGRAM, 0);
    int found = fd < 0 ? 0 : find_lowest_mac(fd, mac);

    if (fd >= 0)
        close(fd);
    if (found == 0)
        return 0;
    put_hex(mac, sizeof mac, digits);
    return from_digits(options, '2', digits, sizeof digits);
}

const char *vs_uid_find(struct vs_options *options)
{
    if (options->keyed)
        return "the file of its key";
    if (options->has_uid)
        return "its settings";
    if (from_file(options, "/etc/machine-id"))
        return "/etc/machine-id";
    if (from_file(options, "/var/lib/dbus/machine-id"))
        return "/var/lib/dbus/machine-id";
    if (from_serial(options))
        return "the processor's serial number";
    return from_mac(options) ? "a MAC address" : NULL;
}

void vs_uid_text(const uint8_t uid[VS_UID_SIZE], char text[2 * VS_UID_SIZE + 1])
{
    put_hex(uid, VS_UID_SIZE, text);
    text[2 * VS_UID_SIZE] = '\0';
}
