/* SPDX-License-Identifier: MIT */
#include "report.h"

#include <poll.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define LINE_MAX_BYTES 400

static char prefix[24] = "vsensed";
static unsigned int dropped;

void vs_report_as(unsigned int tag)
{
    snprintf(prefix, sizeof prefix, "vsensed %u", tag);
}

/* stderr is shared with other programs, so it cannot be made non-blocking: look first. */
static int has_room(void)
{
    struct pollfd fd = {STDERR_FILENO, POLLOUT, 0};

    return poll(&fd, 1, 0) > 0;
}

static void put(const char *format, va_list arguments)
{
    char line[LINE_MAX_BYTES + 2];
    ssize_t ignored;
    size_t len = (size_t)snprintf(line, LINE_MAX_BYTES, "%s: ", prefix);

    vsnprintf(line + len, LINE_MAX_BYTES - len, format, arguments);
    len = strlen(line);
    line[len] = '\n';
    /* one write: lines of several daemons on one terminal do not mix */
    ignored = write(STDERR_FILENO, line, len + 1);
    (void)ignored;
}

static void tell_dropped(const char *format, ...)
{
    va_list arguments;

    va_start(arguments, format);
    put(format, arguments);
    va_end(arguments);
}

void vs_report(const char *format, ...)
{
    va_list arguments;

    if (dropped > 0 && has_room()) {
        tell_dropped("%u lines were dropped: nobody read them", dropped);
        dropped = 0;
    }
    if (!has_room()) {
        dropped++;
        return;
    }
    va_start(arguments, format);
    put(format, arguments);
    va_end(arguments);
}
