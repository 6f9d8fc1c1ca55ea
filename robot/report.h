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

/* What went wrong, in few bytes: "errno 2" for a number of errno.h, valid until the next call. The
 * system's own texts would be a fiftieth of the daemon; README.md lists the usual numbers, and the
 * host says them in words where it passes them on. */
const char *vs_trouble(int number);

/* One line of plain English for what a base gives back: VS_OK, or VS_ERR_IO and its neighbours. */
const char *vs_base_trouble(int err);

/* Prints on stdout what somebody asked for, and waits until it is taken. */
void vs_print(const char *text);

#endif
