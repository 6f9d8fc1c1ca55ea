/* SPDX-License-Identifier: MIT */
#include "check.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdarg.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "base_sensors.h"
#include "guard_rights.h"
#include "key.h"
#include "number.h"
#include "report.h"
#include "uid.h"
#include "wiggle.h"
#include "../c_src/vs_posix.h"

#define LINE_MAX_BYTES 500
#define NAPS 20                 /* so many short sleeps show the timer's grain */
#define NAP_NS 2000000u         /* [ns] each */
#define COARSE_NS 20000000u     /* [ns] mostly later than this and no step is on time */
#define FIRST_SANE_S 1577836800 /* [s] the beginning of 2020 */
#define CONNECT_NS 2000000000u  /* [ns] a host on the same network takes far less */
#define FIND_NS 4000000000u     /* [ns] the base may take to be found */
#define ANSWER_NS 500000000u    /* [ns] and to answer then */

static int say(const char *what, int ok, const char *format, ...) VS_FORMAT_CHECKED(3, 4);

/* One line of the report. Returns its ok. */
static int say(const char *what, int ok, const char *format, ...)
{
    char line[LINE_MAX_BYTES + 1];
    va_list arguments;
    size_t len = vs_format(line, LINE_MAX_BYTES, "%-8s %-4s ", what, ok ? "ok" : "BAD");

    va_start(arguments, format);
    len += vs_format_list(line + len, LINE_MAX_BYTES - len, format, arguments);
    va_end(arguments);
    line[len] = '\n';
    line[len + 1] = '\0';
    vs_print(line);
    return ok;
}

/* Puts value into its place among the count values before it, the smallest first. */
static void insert(uint64_t *values, int count, uint64_t value)
{
    while (count > 0 && values[count - 1] > value) {
        values[count] = values[count - 1];
        count--;
    }
    values[count] = value;
}

static unsigned int tenths_ms(uint64_t ns)
{
    return (unsigned int)((ns + 50000u) / 100000u);
}

/* Everything is timed with the board's clock: it has to run on, and poll() to wake soon. */
static int check_clock(void)
{
    uint64_t late_ns[NAPS];
    unsigned int mostly;
    unsigned int worst;
    int i;

    for (i = 0; i < NAPS; i++) {
        uint64_t began_ns = vs_posix_now_ns();
        uint64_t took_ns;

        poll(NULL, 0, (int)(NAP_NS / 1000000u));
        took_ns = vs_posix_now_ns() - began_ns;
        if (took_ns < NAP_NS / 2)
            return say("clock", 0, "the clock stands still: this kernel has no working timer");
        insert(late_ns, i, took_ns > NAP_NS ? took_ns - NAP_NS : 0);
    }
    if (late_ns[NAPS / 2] > COARSE_NS)
        return say("clock", 0, "timers wake %u ms late: end whatever keeps this board busy (top)",
                   tenths_ms(late_ns[NAPS / 2]) / 10);
    if (time(NULL) < FIRST_SANE_S)
        return say("clock", 1,
                   "timers are good; the calendar is wrong, which only log files notice");
    mostly = tenths_ms(late_ns[NAPS / 2]);
    worst = tenths_ms(late_ns[NAPS - 1]);
    return say("clock", 1, "timers wake %u.%u ms late, %u.%u ms at worst", mostly / 10,
               mostly % 10, worst / 10, worst % 10);
}

static int is_address(const struct vs_options *o, struct sockaddr_in *address)
{
    memset(address, 0, sizeof *address);
    address->sin_family = AF_INET;
    address->sin_port = htons(o->port);
    return vs_number_address(o->host, (uint8_t *)&address->sin_addr) == 0;
}

/* A datagram socket that connects says which way packets would go, without sending one. */
static int check_route(const struct vs_options *o, const struct sockaddr_in *host)
{
    struct sockaddr_in own;
    socklen_t size = sizeof own;
    const uint8_t *at = (const uint8_t *)&own.sin_addr; /* in the network's order */
    int fd = socket(AF_INET, SOCK_DGRAM, 0);
    int why = 0;

    if (fd < 0 || connect(fd, (const struct sockaddr *)host, sizeof *host) != 0 ||
        getsockname(fd, (struct sockaddr *)&own, &size) != 0)
        why = errno;
    if (fd >= 0)
        close(fd);
    if (why != 0)
        return say("network", 0, "no way to %s: %s; join the host's network (ip address, ip route)",
                   o->host, vs_trouble(why));
    return say("network", 1, "this board is %d.%d.%d.%d on the way to %s", at[0], at[1], at[2],
               at[3], o->host);
}

/* Connects. Returns 0, or the errno of what went wrong. */
static int try_host(const struct sockaddr_in *host)
{
    int fd = socket(AF_INET, SOCK_STREAM, 0);
    struct pollfd waited = {fd, POLLOUT, 0};
    socklen_t size = sizeof(int);
    int why = 0;

    if (fd < 0)
        return errno;
    fcntl(fd, F_SETFL, O_NONBLOCK);
    if (connect(fd, (const struct sockaddr *)host, sizeof *host) != 0)
        why = errno;
    if (why == EINPROGRESS)
        why = poll(&waited, 1, (int)(CONNECT_NS / 1000000u)) > 0 ? 0 : ETIMEDOUT;
    if (why == 0 && getsockopt(fd, SOL_SOCKET, SO_ERROR, &why, &size) != 0)
        why = errno;
    close(fd);
    return why;
}

static int check_host(const struct vs_options *o, const struct sockaddr_in *host)
{
    unsigned int port = o->port;
    int why = try_host(host);

    if (why == 0)
        return say("host", 1, "%s answers on port %u", o->host, port);
    if (why == ECONNREFUSED)
        return say("host", 1, "%s is there; no experiment runs on its port %u now", o->host, port);
    return say("host", 0, "%s does not answer on port %u: %s; is it switched on, is this its"
               " address, does its firewall let TCP and UDP %u in?",
               o->host, port, vs_trouble(why), port);
}

static int begins(const char *text, const char *with)
{
    return strncmp(text, with, strlen(with)) == 0;
}

/* Which module, overlay or other name a device lacks that is not there. */
static const char *find_device(const char *path)
{
    if (begins(path, "/dev/i2c-") && access("/sys/class/i2c-dev", F_OK) != 0)
        return "i2c-dev is not loaded: modprobe i2c-dev, and a line i2c-dev in /etc/modules";
    if (begins(path, "/dev/i2c-"))
        return "no such bus (ls /dev/i2c-*): on a Pi-puck it comes with dtoverlay=pi-puck in"
               " /boot/config.txt, and an older Linux calls it /dev/i2c-4 (--base pipuck-old)";
    if (begins(path, "/dev/ttyS") || begins(path, "/dev/ttyO"))
        return "an Overo's port is /dev/ttyS0 until Linux 2.6.36 (--base overo) and /dev/ttyO0"
               " from then on (--base overo-omap)";
    if (begins(path, "the reset"))
        return "is that its number, 24 on a Pi-puck? (ls /sys/class/gpio /dev/gpiochip*)";
    if (begins(path, "/dev/rfcomm"))
        return "pair the robot, and: rfcomm bind 0 ADDRESS";
    return "is it named right, and its driver loaded? (ls /dev)";
}

/* What to do about a device that cannot be opened. */
static const char *cure(int err, int why, const char *path)
{
    if (err == VS_ERR_LOCKED)
        return "another vsensed has it: end that one first";
    if (why == ENOENT || why == ENODEV || why == ENXIO)
        return find_device(path);
    if (why == EACCES || why == EPERM)
        return "run vsensed as root, or as a member of the device's group (ls -l)";
    return "is it a device that such a base can have?";
}

static int is_running(int err)
{
    return err == VS_ERR_BUSY || err == VS_ERR_LATE;
}

/* Has the base found, wheels at 0, and asked once. VS_OK, or how it failed. */
static int ask(struct vs_base *base, struct vs_base_reading *reading)
{
    static const struct vs_base_command rest;
    uint64_t end_ns = vs_posix_now_ns() + FIND_NS;
    int err = VS_ERR_BUSY;

    while (is_running(err) || err == VS_ERR_SILENT) {
        err = vs_base_recover(base);
        if (err == VS_ERR_SILENT && vs_posix_now_ns() >= end_ns)
            return err;
    }
    end_ns = vs_posix_now_ns() + ANSWER_NS;
    if (err == VS_OK)
        err = VS_ERR_BUSY;
    while (is_running(err) && vs_posix_now_ns() < end_ns)
        err = vs_base_exchange(base, &rest, reading);
    return is_running(err) ? VS_ERR_SILENT : err;
}

static int hand_back(struct vs_base *base)
{
    uint64_t end_ns = vs_posix_now_ns() + ANSWER_NS;
    int err = VS_ERR_BUSY;

    while (is_running(err) && vs_posix_now_ns() < end_ns)
        err = base->ops->close(base);
    return err;
}

#ifdef VSENSED_DRIVERS
static int wiggle(struct vs_base *base, struct vs_base_reading *reading)
{
    int32_t way[2];
    int err = vs_wiggle(base, reading, way);

    if (err != VS_OK)
        return say("wiggle", 0, "the base failed while it turned: %s",
                   base->news != NULL ? base->news : vs_base_trouble(err));
    if (!reading->has_steps)
        return say("wiggle", 1, "told to turn left and back; it counts no steps: has it?");
    return say("wiggle", way[0] <= -VS_WIGGLE_LEAST && way[1] >= VS_WIGGLE_LEAST,
               "left wheel %d steps, right wheel %d, and back; expected about -%d and %d",
               way[0], way[1], VS_WIGGLE_STEPS_S / 2, VS_WIGGLE_STEPS_S / 2);
}
#endif

/* Whether the boards that the robot should have answer, too. */
static int check_boards(struct vs_base *base)
{
    static const struct vs_board_request nothing;
    uint64_t end_ns = vs_posix_now_ns() + ANSWER_NS;
    int i;

    while (base->news == NULL && vs_posix_now_ns() < end_ns) {
        for (i = 0; i < VS_BOARDS; i++)
            vs_boards_ask(&base->boards, i, &nothing, vs_posix_now_ns(), &base->news);
        if (vs_boards_are_well(&base->boards))
            return 1;
        poll(NULL, 0, (int)(NAP_NS / 1000000u));
    }
    return say("base", 0, "%s: is it plugged in, is that its bus?",
               base->news != NULL ? base->news : "a board does not answer");
}

static int check_base(const struct vs_options *o)
{
    static struct vs_base base;
    const char *kind = o->base.ops->name;
    struct vs_base_reading reading;
    int good = 1;
    int err;
    int why;

    memset(&reading, 0, sizeof reading);
    reading.battery_low = VS_UNKNOWN;
    err = vs_base_open(&base, &o->base);
    why = errno;
    if (err != VS_OK)
        return say("base", 0, "cannot open %s: %s; %s", base.news,
                   err == VS_ERR_IO ? vs_trouble(why) : vs_base_trouble(err),
                   cure(err, why, base.news));
    err = ask(&base, &reading);
    if (err == VS_OK) {
        good = check_boards(&base);
#ifdef VSENSED_DRIVERS
        if (o->wiggle)
            good &= wiggle(&base, &reading);
#endif
        reading.boards = base.boards.reading;
        err = hand_back(&base);
    }
    if (err != VS_OK && base.news != NULL)
        return say("base", 0, "%s on %s: %s", kind, o->base.device, base.news);
    if (err != VS_OK)
        return say("base", 0, "%s on %s: %s; is the robot switched on, does it run the firmware for"
                   " '%s', is this its line?", kind, o->base.device, vs_base_trouble(err), kind);
    if (vs_base_battery_low(&reading) == 1)
        return say("base", 0, "%s on %s answers, but its battery is low: charge it", kind,
                   o->base.device);
    return say("base", good, "%s on %s answers, wheels at 0", kind, o->base.device);
}

/* It is not opened: that would start it, and some cannot be stopped again. */
static int check_watchdog(const char *path)
{
    if (access(path, W_OK) != 0)
        return say("watchdog", 0, "%s: %s; load the board's driver (modprobe), or leave --watchdog"
                   " out", path, vs_trouble(errno));
    return say("watchdog", 1, "%s is there; whether it is free a start tells", path);
}

/* Last of all, because it is this process that gets them. A guard works without them. */
static int check_guard(void)
{
    char text[VS_RIGHTS_TEXT];
    unsigned int refused = vs_rights_take(NULL, 0);

    if (refused == 0)
        return say("guard", 1, "memory, out-of-memory score and priority are what it asks for");
    vs_rights_text(refused, text);
    return say("guard", 1, "runs %s: the system refuses; run vsensed as root", text);
}

/* What of this robot was measured; nothing is wrong with a robot of which nothing was. */
static int say_calibration(const struct vs_calibration *calibration)
{
    char line[LINE_MAX_BYTES];
    size_t len = 0;
    int i;

    for (i = 0; i < VS_CAL_SETTINGS; i++)
        if (calibration->text[i] != NULL)
            len += vs_format(line + len, sizeof line - len, "%s%s %s", len > 0 ? "; " : "",
                             vs_calibration_name((enum vs_calibrated)i), calibration->text[i]);
    return say("scales", 1, "%s", len > 0 ? line : "none: sensors and wheels count as nominal");
}

/* Who it will be for the host: what a start looks at, too. */
static int check_uid(const struct vs_options *o)
{
    struct vs_options own = *o;
    char text[2 * VS_UID_SIZE + 1];
    char why[LINE_MAX_BYTES];
    const char *source;

    if (vs_key_load(&own, why, sizeof why) != 0)
        return say("key", 0, "%s", why);
    say("key", 1, "%s", own.keyed ? own.key_file : "none: it obeys anyone who sends commands");
    source = vs_uid_find(&own);
    if (source == NULL)
        return say("uid", 0, "%s", vs_uid_missing);
    vs_uid_text(own.uid, text);
    return say("uid", 1, "%s, from %s", text, source);
}

int vs_check_run(const struct vs_options *options)
{
    struct sockaddr_in host;
    int good = check_clock() & check_uid(options) & say_calibration(&options->calibration);

    if (!is_address(options, &host)) {
        good &= say("network", 0, "host: expected a numeric IPv4 address, got '%s'",
                    options->host);
    } else if (check_route(options, &host)) {
        good &= check_host(options, &host);
    } else {
        good = 0;
    }
    if (options->watchdog != NULL)
        good &= check_watchdog(options->watchdog);
    good &= check_base(options);
    good &= check_guard();
    return good ? 0 : 1;
}
