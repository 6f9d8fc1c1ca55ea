/* SPDX-License-Identifier: MIT */
/*
 * radio.h on boards with this radio and that: its system calls are replaced before it is read.
 * Expected: the table of net/wireless/wext-proc.c (Linux 2.6.20 to 6.9), as it was read on boards,
 * and struct iwreq of linux/wireless.h (WE 22).
 */
#include <fcntl.h>
#include <netinet/in.h>
#include <stdint.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "check.h"
#include "../../robot/radio.h"

#define HEAD "Inter-| sta-|   Quality        |   Discarded packets               | Missed | WE\n" \
             " face | tus | link level noise |  nwid  crypt   frag  retry   misc | beacon | 22\n"

static const char *contents;
static size_t read_so_far;
static uint32_t way_from; /* packets to the host come from there, 0: there is no way */
static int knows_rate, knows_power;

static int fake_open(void)
{
    read_so_far = 0;
    return contents != NULL ? 5 : -1;
}

/* Some bytes at a time, as files in /proc may. */
static ssize_t fake_read(char *buf, size_t size)
{
    size_t left = strlen(contents + read_so_far);
    size_t len = left < 100 ? left : 100;

    len = len < size ? len : size;
    memcpy(buf, contents + read_so_far, len);
    read_so_far += len;
    return (ssize_t)len;
}

static int fake_getsockname(void *address)
{
    struct sockaddr_in own;

    memset(&own, 0, sizeof own);
    own.sin_family = AF_INET;
    own.sin_addr.s_addr = way_from;
    memcpy(address, &own, sizeof own);
    return way_from != 0 ? 0 : -1;
}

/* wlan0 is 10.0.0.1, wlan1 is 10.0.0.2, and others have no address. */
static int fake_ioctl(unsigned long what, void *argument)
{
    unsigned char request[40] = {0}; /* name, and what comes behind it */
    struct sockaddr_in address;
    int32_t bits_s = 54000000;

    memcpy(request, argument, 32);
    memset(&address, 0, sizeof address);
    address.sin_family = AF_INET;
    if (strncmp((char *)request, "wlan", 4) != 0 || request[4] > '1')
        return -1;
    address.sin_addr.s_addr = htonl(0x0A000001u + (uint32_t)(request[4] - '0'));
    if (what == 0x8915) {
        memcpy(request + 16, &address, sizeof address);
    } else if (what == 0x8B21 && knows_rate) {
        memcpy(request + 16, &bits_s, sizeof bits_s);
    } else if (what == 0x8B2D && knows_power >= 0) {
        request[16 + 4 + 1] = (unsigned char)!knows_power; /* iw_param.disabled */
    } else {
        return -1;
    }
    memcpy(argument, request, 32);
    return 0;
}

#define open(path, flags) ((void)(path), fake_open())
#define read(fd, buf, size) fake_read(buf, size)
#define close(fd) ((void)(fd))
#define connect(fd, address, size) ((void)(fd), (void)(size), way_from != 0 ? 0 : -1)
#define getsockname(fd, address, size) ((void)(size), fake_getsockname(address))
#define ioctl(fd, request, argument) ((void)(fd), fake_ioctl((unsigned long)(request), argument))
#include "../../robot/networks.c"
#include "../../robot/radio.c"

static struct vs_radio_look look(const char *text, uint32_t own)
{
    struct vs_radio_look seen;

    contents = text;
    way_from = htonl(own);
    look_at_all(9, htonl(0x0A0000FEu), &seen);
    return seen;
}

static void check(const char *what, struct vs_radio_look seen, int signal_dbm, unsigned int retries,
                  unsigned int bit_rate, unsigned int power_saving)
{
    CHECK_FOR(what, seen.signal_dbm == signal_dbm && seen.retries == retries);
    CHECK_FOR(what, seen.bit_rate == bit_rate && seen.power_saving == power_saving);
}

static const char pi[] = HEAD " wlan0: 0000   46.  -64.  -256        0      0      0    312      0"
                              "        0\n";

static void test_a_radio_is_told(void)
{
    knows_rate = 1;
    knows_power = 1;
    check("a Pi", look(pi, 0x0A000001), -64, 312, 540, 1);
    knows_power = 0;
    check("awake", look(pi, 0x0A000001), -64, 312, 540, 0);
    knows_power = -1;
    knows_rate = 0;
    check("no ioctls", look(pi, 0x0A000001), -64, 312, 0, VS_UNKNOWN);
}

/* The one that packets to the host leave by, and no other. */
static void test_which_radio(void)
{
    static const char two[] =
        HEAD " wlan0: 0000   60.  -50.  -256        0      0      0      0      0        0\n"
             " wlan1: 0000   30.  -80.  -256        0      0      0      7      0        0\n";

    knows_rate = 1;
    knows_power = 0;
    check("the first", look(two, 0x0A000001), -50, 0, 540, 0);
    check("the second", look(two, 0x0A000002), -80, 7, 540, 0);
    check("a cable", look(two, 0x0A000003), 0, VS_NEVER_US, 0, VS_UNKNOWN);
    check("no way", look(two, 0), 0, VS_NEVER_US, 0, VS_UNKNOWN);
}

static void test_what_nobody_knows(void)
{
    static const char raw[] = HEAD " wlan0: 0000   70.   70.    0        0      0      0      9"
                                   "      0        0\n";
    static const char down[] = HEAD " wlan0: 0000    0     0     0        0      0      0      0"
                                    "      0        0\n";

    knows_rate = 0;
    knows_power = -1;
    check("no dBm", look(raw, 0x0A000001), 0, 9, 0, VS_UNKNOWN);
    check("down", look(down, 0x0A000001), 0, 0, 0, VS_UNKNOWN);
    check("no radio", look(HEAD, 0x0A000001), 0, VS_NEVER_US, 0, VS_UNKNOWN);
    check("no file", look(NULL, 0x0A000001), 0, VS_NEVER_US, 0, VS_UNKNOWN);
    check("cut", look(HEAD " wlan0: 0000   46.  -6", 0x0A000001), -6, 0, 0, VS_UNKNOWN);
    check("no text", look(HEAD " wlan0:", 0x0A000001), 0, 0, 0, VS_UNKNOWN);
    check("a long name", look(HEAD " wlan0000000000000000000: 0000 46. -64. -256 0 0 0 1 0 0\n",
                              0x0A000001), 0, VS_NEVER_US, 0, VS_UNKNOWN);
}

/* A process that says nothing any more, as one that its driver holds. */
static void test_silence(void)
{
    struct vs_radio_look said = {5, 110, -70, 0};
    struct vs_radio radio;
    struct vs_telemetry t;
    int ends[2];
    int i;

    memset(&radio, 0, sizeof radio);
    forget(&radio.look);
    CHECK(socketpair(AF_UNIX, SOCK_SEQPACKET, 0, ends) == 0);
    radio.socket = ends[0];
    vs_radio_tell(&radio, UINT64_C(1000000000), &t);
    CHECK(t.signal_dbm == 0 && t.retries == VS_NEVER_US && t.power_saving == VS_UNKNOWN);
    CHECK(send(ends[1], &said, sizeof said, 0) == (ssize_t)sizeof said);
    vs_radio_tell(&radio, UINT64_C(1500000000), &t);
    CHECK(t.signal_dbm == 0); /* it is not asked so often */
    for (i = 2; i <= 5; i++) {
        vs_radio_tell(&radio, (uint64_t)i * 1000000000, &t);
        CHECK(t.signal_dbm == -70 && t.retries == 5 && t.bit_rate == 110 && t.power_saving == 0);
    }
    vs_radio_tell(&radio, UINT64_C(6000000000), &t);
    CHECK(t.signal_dbm == 0 && t.bit_rate == 0);
}

int main(void)
{
    test_a_radio_is_told();
    test_which_radio();
    test_what_nobody_knows();
    test_silence();
    return 0;
}
