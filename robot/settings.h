/* SPDX-License-Identifier: MIT */
/*
 * settings.h - the text of a settings file, line by line:
 *
 *     # a comment
 *     host = 192.168.1.10
 *     base = argos:/dev/ttyS0
 *
 * A name and its value, blanks around both do not count; a value reaches to the end of
 * its line. Empty lines and lines that begin with # are passed over. Pure.
 */
#ifndef VS_SETTINGS_H
#define VS_SETTINGS_H

#include <stddef.h>

#define VS_SETTINGS_MAX 4096 /* [byte] longest file */

struct vs_settings {
    char text[VS_SETTINGS_MAX + 1]; /* the owner's: filled before vs_settings_begin */
    size_t len;                     /* [byte] of text */
    size_t pos;                     /* its own */
    unsigned int line;              /* of what vs_settings_next gave last, from 1 */
};

enum vs_settings_result {
    VS_SETTINGS_END = 0,
    VS_SETTINGS_PAIR = 1,
    VS_SETTINGS_BAD = 2 /* the line is no pair: *name is what stands in it */
};

/* Begins with the first line. */
void vs_settings_begin(struct vs_settings *settings);

/* The next pair. *name and *value point into the text, each ended by a NUL that is put
 * there. */
enum vs_settings_result vs_settings_next(struct vs_settings *settings, const char **name,
                                         const char **value);

#endif
