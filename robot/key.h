/* SPDX-License-Identifier: MIT */
/*
 * key.h - the file that holds who a robot is and its key, as `vsense robot deploy` brings it:
 *
 *     uid = 00112233445566778899aabbccddeeff
 *     key = ffeeddccbbaa99887766554433221100
 *
 * Whoever can read it can be the robot: it must be its owner's alone, mode 0600.
 */
#ifndef VS_KEY_H
#define VS_KEY_H

#include "options.h"

/* Reads the file that options->key_file names, if any, into uid and key. Returns 0, or -1 and
 * why, a line that begins with the file's name. */
int vs_key_load(struct vs_options *options, char *why, size_t why_size);

#endif
