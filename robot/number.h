/* SPDX-License-Identifier: MIT */
/*
 * number.h - reads decimal numbers such as -1.5 or 2e-3. In place of strtod(), which is
 * a tenth of the whole daemon and obeys whatever locale a host has set. Pure.
 */
#ifndef VS_NUMBER_H
#define VS_NUMBER_H

#include <stddef.h>
#include <stdint.h>

/* Reads the number that text begins with: sign, digits with or without a point, and an
 * exponent. Of up to 15 digits and with an exponent of up to 22 it is the nearest double, as from
 * strtod(), else one within 4 units of its last place. Returns how many characters it
 * has, 0 if it is none or too large; *value is then left alone. */
size_t vs_number_read(const char *text, double *value);

/* Reads a text that is nothing but a whole number, with or without a sign. Returns 0, or -1 if
 * it is none, or not from least to most. */
int vs_number_whole(const char *text, int64_t least, int64_t most, int64_t *value);

/* Reads a text that is nothing but an IPv4 address, four numbers with points between them, as
 * inet_pton(), which has IPv6 besides. Returns 0, or -1. */
int vs_number_address(const char *text, uint8_t address[4]);

/* Reads the 32 hexadecimal digits that text begins with; if whole is 1 it must be nothing else.
 * Returns 0, or -1. */
int vs_number_hex(const char *text, int whole, uint8_t bytes[16]);

#endif
