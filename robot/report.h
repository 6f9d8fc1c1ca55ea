/* SPDX-License-Identifier: MIT */
/* report.h - the daemon's talk: lines on stderr that begin with "vsensed TAG: ". */
#ifndef VS_REPORT_H
#define VS_REPORT_H

#include "../c_src/vs_format.h"

/* Sets the tag that the lines begin with. */
void vs_report_as(unsigned int tag);

/* One line, of vs_format, without its newline; at most 400 characters. Never waits: while
 * nobody reads stderr lines are dropped, and their number is told when there is room. */
void vs_report(const char *format, ...) VS_FORMAT_CHECKED(1, 2);

/* Prints on stdout what somebody asked for, and waits until it is taken. */
void vs_print(const char *text);

#endif
