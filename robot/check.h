/* SPDX-License-Identifier: MIT */
/*
 * check.h - `vsensed --check`: whether clock, network, host and base of this board are
 * well, one line each on standard output, with what is wrong and how to mend it.
 */
#ifndef VS_CHECK_H
#define VS_CHECK_H

#include "options.h"

/* Looks at everything, in at most 8 s. The base ends with its wheels at 0 and its LEDs
 * off. Returns the exit status: 0 all is well, 1 something is not. */
int vs_check_run(const struct vs_options *options);

#endif
