/* SPDX-License-Identifier: MIT */
/*
 * vs_format.h - text with values in it, for what runs on robots. The C library's printf
 * brings its files, locks and floating point along, a tenth of the whole daemon.
 */
#ifndef VS_FORMAT_H
#define VS_FORMAT_H

#include <stdarg.h>
#include <stddef.h>

#if defined __GNUC__
#define VS_FORMAT_CHECKED(text, first) __attribute__((format(printf, text, first)))
#else
#define VS_FORMAT_CHECKED(text, first)
#endif

/* As snprintf, of which it knows %s, %d, %u and %%, the lengths l and ll, a width, left with
 * "-", and the precision of %s, each as a number or "*". What does not fit is cut off.
 * Returns the length of what is in buf, which is always ended by a zero; size is not 0. */
size_t vs_format(char *buf, size_t size, const char *format, ...) VS_FORMAT_CHECKED(3, 4);

/* The same with a list of values. */
size_t vs_format_list(char *buf, size_t size, const char *format, va_list values)
    VS_FORMAT_CHECKED(3, 0);

#endif
