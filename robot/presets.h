/* SPDX-License-Identifier: MIT */
/* presets.h - boards by name, in place of what --base is told of them. Pure. */
#ifndef VS_PRESETS_H
#define VS_PRESETS_H

#include <stddef.h>

struct vs_preset {
    const char *name;  /* NULL ends the table */
    const char *base;  /* as after --base */
    const char *about; /* which boards, for help */
};

extern const struct vs_preset vs_presets[];

/* Puts what a board's name stands for in its place: "pipuck,rab" is
 * "gctronic:/dev/i2c-12,rab". Returns expanded, or text itself if it begins with no board's
 * name or does not fit. */
const char *vs_preset_expand(const char *text, char *expanded, size_t size);

#endif
