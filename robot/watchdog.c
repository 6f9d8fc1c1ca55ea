/* SPDX-License-Identifier: MIT */
#include "watchdog.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/watchdog.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "report.h"
#include "../c_src/vs_posix.h"

static int device = -1;
static uint64_t fed_ns;

void vs_watchdog_open(const char *path)
{
    int seconds = VS_WATCHDOG_S;

    if (path == NULL)
        return;
    device = open(path, O_WRONLY | O_NONBLOCK);
    if (device < 0) {
        vs_report("--watchdog %s: %s; going on without it", path,
                  errno == EBUSY ? "another program has it (systemd's RuntimeWatchdogSec, or a"
                                   " watchdog daemon)" : vs_trouble(errno));
        return;
    }
    if (lseek(device, 0, SEEK_CUR) >= 0) {
        vs_report("--watchdog %s: is no device; going on without it", path);
        close(device);
        device = -1;
        return;
    }
    vs_posix_keep_from_children(device);
    (void)ioctl(device, WDIOC_SETTIMEOUT, &seconds); /* some have one time-out only */
}

static void say(char word)
{
    ssize_t ignored = write(device, &word, 1);

    (void)ignored; /* then it is not fed, which is what it is there for */
}

void vs_watchdog_feed(uint64_t now_ns)
{
    if (device < 0 || now_ns - fed_ns < VS_WATCHDOG_FEED_NS)
        return;
    fed_ns = now_ns;
    say('\0');
}

void vs_watchdog_end(int orderly)
{
    if (device < 0 || !orderly)
        return;
    say('V'); /* "magic close": Documentation/watchdog/watchdog-api of Linux */
    close(device);
    device = -1;
}
