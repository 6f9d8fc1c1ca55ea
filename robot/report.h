/* SPDX-License-Identifier: MIT */
/* report.h - the daemon's talk: lines on stderr that begin with "vsensed TAG: ". */
#ifndef VS_REPORT_H
#define VS_REPORT_H

/* Sets the tag that the lines begin with. */
void vs_report_as(unsigned int tag);

/* One line, printf-like, without its newline; at most 400 characters. Never waits: while
 * nobody reads stderr lines are dropped, and their number is told when there is room. */
void vs_report(const char *format, ...);

#endif
