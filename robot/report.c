/* SPDX-License-Identifier: MIT */
#include "report.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define LINE_MAX_BYTES 400

static char prefix[24] = "vsensed";

void vs_report_as(unsigned int tag)
{
    snprintf(prefix, sizeof prefix, "vsensed %u", tag);
}

void vs_report(const char *format, ...)
{
    char line[LINE_MAX_BYTES + 2];
    ssize_t ignored;
    va_list arguments;
    size_t len = (size_t)snprintf(line, LINE_MAX_BYTES, "%s: ", prefix);

    va_start(arguments, format);
    vsnprintf(line + len, LINE_MAX_BYTES - len, format, arguments);
    va_end(arguments);
    len = strlen(line);
    line[len] = '\n';
    /* one write: lines of several daemons on one terminal do not mix */
    ignored = write(STDERR_FILENO, line, len + 1);
    (void)ignored;
}
