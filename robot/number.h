/* SPDX-License-Identifier: MIT */
/*
 * number.h - reads decimal numbers such as -1.5 or 2e-3. In place of strtod(), which is
 * a tenth of the whole daemon and obeys whatever locale a host has set. Pure.
 */
#ifndef VS_NUMBER_H
#define VS_NUMBER_H

#include <stddef.h>

/* Reads the number that text begins with: sign, digits with or without a point, and an
 * exponent. Of up to 15 digits and with an exponent of up to 22 it is the nearest double, as from
 * strtod(), else one within 4 units of its last place. Returns how many characters it
 * has, 0 if it is none or too large; *value is then left alone. */
size_t vs_number_read(const char *text, double *value);

#endif
