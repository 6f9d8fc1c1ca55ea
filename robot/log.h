/* SPDX-License-Identifier: MIT */
/*
 * log.h - lines on their way to the host: kept until the host has heard them, told one
 * per TELEMETRY, the oldest first. Where there are too many the oldest goes: its number
 * is missing at the host, which says so. Pure.
 */
#ifndef VS_LOG_H
#define VS_LOG_H

#include "../c_src/vs_body.h"

#define VS_LOG_LINES 8

struct vs_log {
    uint32_t newest; /* number of the newest line, 0 = none yet */
    uint32_t heard;  /* up to here the host has them, or they were dropped */
    char lines[VS_LOG_LINES][VS_LOG_MAX + 1]; /* line n at n % VS_LOG_LINES */
};

/* Adds a line, cut to VS_LOG_MAX bytes; what is no clean text becomes '?'. */
void vs_log_add(struct vs_log *log, const char *line);

/* The host has heard all lines up to this number. */
void vs_log_heard(struct vs_log *log, uint32_t number);

/* The line that is due, "" with *number 0 if none is. */
const char *vs_log_due(const struct vs_log *log, uint32_t *number);

#endif
