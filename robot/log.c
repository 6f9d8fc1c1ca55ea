/* SPDX-License-Identifier: MIT */
#include "log.h"

#include <string.h>

#include "../c_src/vs_bytes.h"

/* Bytes of the clean character at text, of which len bytes are left; 0 if there is none. */
static size_t character(const char *text, size_t len)
{
    size_t size;

    for (size = 1; size <= 4 && size <= len; size++)
        if (vs_text_check((const uint8_t *)text, size, 0) == VS_OK)
            return size;
    return 0;
}

void vs_log_add(struct vs_log *log, const char *line)
{
    char *out = log->lines[++log->newest % VS_LOG_LINES];
    size_t left = strlen(line);
    size_t used = 0;

    while (left > 0) {
        size_t size = character(line, left);

        if (used + (size ? size : 1) > VS_LOG_MAX)
            break;
        if (size == 0)
            out[used++] = '?';
        else
            memcpy(out + used, line, size);
        used += size;
        size = size ? size : 1;
        line += size;
        left -= size;
    }
    out[used] = '\0';
    if (log->newest - log->heard > VS_LOG_LINES)
        log->heard = log->newest - VS_LOG_LINES;
}

void vs_log_heard(struct vs_log *log, uint32_t number)
{
    if (number > log->heard && number <= log->newest)
        log->heard = number;
}

const char *vs_log_due(const struct vs_log *log, uint32_t *number)
{
    *number = log->heard < log->newest ? log->heard + 1 : 0;
    return *number != 0 ? log->lines[*number % VS_LOG_LINES] : "";
}
