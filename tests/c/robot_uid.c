/* SPDX-License-Identifier: MIT */
/*
 * uid.h on boards that have this and lack that: its system calls are replaced before it is
 * read. Expected: the order that its header documents, and what the kernel's files look like.
 */
#include <fcntl.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "check.h"

#define FILES 4
#define MACHINE "0123456789abcdef0123456789abcdef"

static const char *const paths[FILES] = {"/etc/machine-id", "/var/lib/dbus/machine-id",
                                         "/proc/cpuinfo", "/proc/net/dev"};
static const char *contents[FILES]; /* NULL: there is no such file */
static size_t read_so_far[FILES];

static int fake_open(const char *path)
{
    int i;

    for (i = 0; i < FILES; i++) {
        read_so_far[i] = 0;
        if (strcmp(path, paths[i]) == 0)
            return contents[i] != NULL ? i : -1;
    }
    return -1;
}

/* Some bytes at a time, as files in /proc may. */
static ssize_t fake_read(int fd, char *buf, size_t size)
{
    size_t left = strlen(contents[fd] + read_so_far[fd]);
    size_t len = left < 100 ? left : 100;

    len = len < size ? len : size;
    memcpy(buf, contents[fd] + read_so_far[fd], len);
    read_so_far[fd] += len;
    return (ssize_t)len;
}

/* The address of a network as its name has it: eth1 has 00:11:22:33:44:01. */
static int fake_ioctl(void *argument)
{
    struct {
        char name[16];
        struct sockaddr address;
    } request;
    uint8_t mac[6] = {0x00, 0x11, 0x22, 0x33, 0x44, 0};

    memcpy(&request, argument, sizeof request);
    if (strcmp(request.name, "gone0") == 0)
        return -1;
    request.address.sa_family = strcmp(request.name, "lo") == 0 ? 772 : 1;
    mac[0] = strncmp(request.name, "usb", 3) == 0 ? 0x02 : 0x00;
    mac[5] = (uint8_t)(request.name[strlen(request.name) - 1] - '0');
    memcpy(request.address.sa_data, mac, sizeof mac);
    memcpy(argument, &request, sizeof request);
    return 0;
}

#define open(path, flags) fake_open(path)
#define read(fd, buf, size) fake_read(fd, buf, size)
#define close(fd) ((void)(fd))
#define socket(family, type, protocol) 9
#define ioctl(fd, request, argument) ((void)(fd), (void)(request), fake_ioctl(argument))
#include "../../robot/networks.c"
#include "../../robot/uid.c"

/* The uid with tag 0, in hexadecimal. */
static const char *uid(const char *source)
{
    static char text[2 * VS_UID_SIZE + 1];
    struct vs_options options;
    const char *found;
    size_t i;

    vs_options_init(&options);
    found = vs_uid_find(&options);
    CHECK_FOR(source, found != NULL && strcmp(found, source) == 0 && options.has_uid);
    for (i = 0; i < VS_UID_SIZE; i++)
        snprintf(text + 2 * i, 3, "%02x", options.uid[i]);
    return text;
}

static void board(const char *machine, const char *dbus, const char *cpuinfo, const char *networks)
{
    contents[0] = machine;
    contents[1] = dbus;
    contents[2] = cpuinfo;
    contents[3] = networks;
}

static const char pi[] = "processor\t: 0\nmodel name\t: ARMv6-compatible processor rev 7 (v6l)\n\n"
                         "Hardware\t: BCM2835\nRevision\t: 9000c1\nSerial\t\t: 00000000a1b2c3d4\n";
static const char overo[] = "Hardware\t: Gumstix Overo\nRevision\t: 0020\n"
                            "Serial\t\t: 0000000000000000\n";
static const char networks[] = "Inter-|   Receive                      |  Transmit\n"
                               " face |bytes    packets errs drop fifo |bytes    packets\n"
                               "    lo:     100       1    0    0    0      100       1\n"
                               " gone0:       0       0    0    0    0        0       0\n"
                               "  usb0:       0       0    0    0    0        0       0\n"
                               " wlan7:   12345      10    0    0    0    54321      10\n"
                               "  eth3:       0       0    0    0    0        0       0\n";

static void test_order(void)
{
    board(MACHINE "\n", "f" MACHINE, pi, networks);
    CHECK(strcmp(uid("/etc/machine-id"), MACHINE) == 0);
    board(NULL, MACHINE "\n", pi, networks);
    CHECK(strcmp(uid("/var/lib/dbus/machine-id"), MACHINE) == 0);
    board("", "uninitialized\n", pi, networks); /* an image that was made to be copied */
    CHECK(strcmp(uid("the processor's serial number"), "000010000000000000000000a1b2c3d4") == 0);
    board(NULL, NULL, overo, networks);
    CHECK(strcmp(uid("a MAC address"), "00002000000000000000001122334403") == 0);
    board(NULL, NULL, NULL, networks);
    CHECK(strcmp(uid("a MAC address"), "00002000000000000000001122334403") == 0);
}

static void test_nothing(void)
{
    struct vs_options options;

    board(NULL, NULL, overo, "Inter-|\n face |\n    lo: 1\n  usb0: 2\n");
    vs_options_init(&options);
    CHECK(vs_uid_find(&options) == NULL && !options.has_uid);
    board("00000000000000000000000000000000\n", NULL, "", NULL);
    CHECK(vs_uid_find(&options) == NULL);
}

/* What the settings say wins, and a tag is mixed into all others. */
static void test_settings_and_tag(void)
{
    struct vs_options options;

    board(NULL, NULL, pi, NULL);
    vs_options_init(&options);
    options.tag = 0x1234;
    CHECK(vs_uid_find(&options) != NULL);
    CHECK(options.uid[0] == 0x34 && options.uid[1] == 0x12 && options.uid[15] == 0xd4);
    options.uid[0] = 0x77;
    CHECK(strcmp(vs_uid_find(&options), "its settings") == 0 && options.uid[0] == 0x77);
}

int main(void)
{
    test_order();
    test_nothing();
    test_settings_and_tag();
    return 0;
}
