/* SPDX-License-Identifier: MIT */
#include "report.h"

#include <errno.h>
#include <poll.h>
#include <stdarg.h>
#include <string.h>
#include <unistd.h>

#include "../c_src/vs_err.h"

#define LINE_MAX_BYTES 400

static char prefix[24] = "vsensed";
static unsigned int dropped;

void vs_report_as(unsigned int tag)
{
    vs_format(prefix, sizeof prefix, "vsensed %u", tag);
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
    size_t len = vs_format(line, LINE_MAX_BYTES, "%s: ", prefix);

    len += vs_format_list(line + len, LINE_MAX_BYTES - len, format, arguments);
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

void vs_print(const char *text)
{
    size_t left = strlen(text);

    while (left > 0) {
        ssize_t done = write(STDOUT_FILENO, text, left);

        if (done < 0 && errno != EINTR)
            return;
        text += done > 0 ? done : 0;
        left -= done > 0 ? (size_t)done : 0;
    }
}

const char *vs_trouble(int number)
{
    static char text[sizeof "errno -2147483648"];

    vs_format(text, sizeof text, "errno %d", number);
    return text;
}

const char *vs_base_trouble(int err)
{
    static const char *const texts[] = {
        "the device failed",
        "the device is gone",
        "another process holds the device",
        "the base does not answer",
        "the base's answer makes no sense",
        "the base's answer is late",
        "the base still owes an earlier answer",
    };
    size_t i = (size_t)(VS_ERR_IO - err);

    if (err == VS_OK)
        return "no error";
    return i < sizeof texts / sizeof texts[0] ? texts[i] : "unknown error";
}
