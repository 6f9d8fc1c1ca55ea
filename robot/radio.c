/* SPDX-License-Identifier: MIT */
#include "radio.h"

#include <netinet/in.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "networks.h"
#include "number.h"
#include "signals.h"
#include "../c_src/vs_posix.h"

/* linux/sockios.h and linux/wireless.h */
enum { SIOCGIFADDR_LINUX = 0x8915, SIOCGIWRATE = 0x8B21, SIOCGIWPOWER = 0x8B2D };

/* Columns of /proc/net/wireless behind the name's colon, net/wireless/wext-proc.c */
enum { LEVEL = 2, RETRIES = 7 };

#define WEAKEST_DBM (-127)
#define RATE_UNIT 100000 /* [bit/s] of vs_telemetry.bit_rate */

#ifdef VSENSED_SLOW_CLOCK
static const char *table = "/proc/net/wireless";
static int is_emulated;

void vs_radio_emulate(const char *file)
{
    table = file;
    is_emulated = 1;
}
#else
static const char table[] = "/proc/net/wireless";
#endif

static int32_t column(const char *at, int number)
{
    double value = 0.0;

    while (number-- > 0) {
        at += strspn(at, " ");
        at += strcspn(at, " \n");
    }
    at += strspn(at, " ");
    vs_number_read(at, &value);
    return (int32_t)value;
}

/* The address that packets to the host come from, 0 if there is no way to it. */
static uint32_t own_address(int fd, uint32_t host)
{
    struct sockaddr_in address;
    socklen_t size = sizeof address;

    memset(&address, 0, sizeof address);
    address.sin_family = AF_INET;
    address.sin_port = 1; /* any: nothing is sent */
    address.sin_addr.s_addr = host;
    if (connect(fd, (const struct sockaddr *)&address, sizeof address) != 0 ||
        getsockname(fd, (struct sockaddr *)&address, &size) != 0)
        return 0;
    return address.sin_addr.s_addr;
}

static int has_address(int fd, const char *name, size_t len, uint32_t own)
{
    struct vs_network asked;

#ifdef VSENSED_SLOW_CLOCK
    if (is_emulated)
        return 1;
#endif
    /* the address of a struct sockaddr_in comes after its port */
    return vs_networks_ask(fd, SIOCGIFADDR_LINUX, name, len, &asked) == 0 &&
           memcmp(asked.is.address.sa_data + 2, &own, sizeof own) == 0;
}

#ifdef VSENSED_SLOW_CLOCK
/* What the file of a lab says of the radio whose line it is. */
static void ask_file(const char *line, struct vs_radio_look *look)
{
    const char *rate = strstr(line, "\nrate ");
    const char *power = strstr(line, "\npower ");

    if (rate != NULL)
        look->bit_rate = (uint16_t)(column(rate + 1, 1) / RATE_UNIT);
    if (power != NULL)
        look->power_saving = column(power + 1, 1) != 0;
}
#endif

static void ask(int fd, const char *name, size_t len, struct vs_radio_look *look)
{
    struct vs_network asked;
    int32_t level = column(name + len + 1, LEVEL);

    /* a driver that measures in no unit has numbers above 0 */
    if (level < 0 && level >= WEAKEST_DBM)
        look->signal_dbm = (int8_t)level;
    look->retries = (uint32_t)column(name + len + 1, RETRIES);
#ifdef VSENSED_SLOW_CLOCK
    if (is_emulated) {
        ask_file(name, look);
        return;
    }
#endif
    if (vs_networks_ask(fd, SIOCGIWRATE, name, len, &asked) == 0)
        look->bit_rate = (uint16_t)(asked.is.wireless.value / RATE_UNIT);
    if (vs_networks_ask(fd, SIOCGIWPOWER, name, len, &asked) == 0)
        look->power_saving = !asked.is.wireless.disabled;
}

static void forget(struct vs_radio_look *look)
{
    memset(look, 0, sizeof *look);
    look->retries = VS_NEVER_US;
    look->power_saving = VS_UNKNOWN;
}

static void look_at_all(int fd, uint32_t host, struct vs_radio_look *look)
{
    char text[1024];
    const char *name = text;
    size_t len = 0;
    uint32_t own = own_address(fd, host);

    forget(look);
    vs_networks_read(table, text, sizeof text);
    while (vs_networks_next(&name, &len)) {
        if (has_address(fd, name, len, own)) {
            ask(fd, name, len, look);
            return;
        }
    }
}

/* In the child, until the worker has ended. */
static void become_radio(int socket_fd, uint32_t host)
{
    struct pollfd end = {socket_fd, POLLIN, 0};
    struct vs_radio_look look;
    int fd;

    vs_posix_close_but(socket_fd, -1);
    vs_signals_ignore();
    vs_signals_unblock();
    fd = socket(AF_INET, SOCK_DGRAM, 0);
    do {
        look_at_all(fd, host, &look);
        (void)send(socket_fd, &look, sizeof look, MSG_NOSIGNAL | MSG_DONTWAIT);
    } while (poll(&end, 1, VS_RADIO_MS) == 0);
    _exit(0);
}

void vs_radio_start(struct vs_radio *radio, uint32_t host)
{
    int fd = -1;
    long pid = access(table, F_OK) != 0 ? -1 : vs_signals_fork(&fd);

    if (pid == 0)
        become_radio(fd, host);
    radio->socket = pid < 0 ? -1 : fd;
    forget(&radio->look);
}

static void hear(struct vs_radio *radio, uint64_t now_ns)
{
    if (radio->socket < 0 || now_ns - radio->heard_ns < VS_RADIO_HEAR_NS)
        return;
    radio->heard_ns = now_ns;
    if (++radio->silent >= VS_RADIO_SILENCE)
        forget(&radio->look);
    while (recv(radio->socket, &radio->look, sizeof radio->look, MSG_DONTWAIT) > 0)
        radio->silent = 0;
}

void vs_radio_tell(struct vs_radio *radio, uint64_t now_ns, struct vs_telemetry *t)
{
    hear(radio, now_ns);
    t->signal_dbm = radio->look.signal_dbm;
    t->power_saving = radio->look.power_saving;
    t->bit_rate = radio->look.bit_rate;
    t->retries = radio->look.retries;
}
