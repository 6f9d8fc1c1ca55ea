/* SPDX-License-Identifier: MIT */
/* report.h - the daemon's talk: lines on stderr that begin with "vsensed TAG: ". */
#ifndef VS_REPORT_H
#define VS_REPORT_H

/* Sets the tag that the lines begin with. */
void vs_report_as(unsigned int tag);

/* One line, printf-like, without its newline; at most 400 characters. */
void vs_report(const char *format, ...);

#endif
