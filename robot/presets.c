/* SPDX-License-Identifier: MIT */
#include "presets.h"

#include <string.h>

#include "../c_src/vs_format.h"

/*
 * Sources: the Overo's port: demiurge-project/argos3-epuck, real_robot/real_epuck.cpp:25; from
 * Linux 2.6.37 on OMAP's ports have a driver and a name of their own. The Pi-puck's bus:
 * gctronic/Pi-puck, camera-configuration.c:16, which tries 12 and then 4, as a multiplexer's
 * channels are numbered from 11 on, or from 3.
 */
const struct vs_preset vs_presets[] = {
    {"overo", "argos:/dev/ttyS0", "Gumstix Overo, IRIDIA's firmware, Linux before 2.6.37"},
    {"overo-omap", "argos:/dev/ttyO0", "the same with a newer Linux"},
    {"pipuck", "gctronic:/dev/i2c-12", "Pi-puck, GCtronic's firmware, selector at 10"},
    {"pipuck-old", "gctronic:/dev/i2c-4", "the same with a Linux that has no /dev/i2c-12"},
    {"pipuck-york", "york:/dev/i2c-12", "Pi-puck, York's firmware"},
    {NULL, NULL, NULL},
};

const char *vs_preset_expand(const char *text, char *expanded, size_t size)
{
    size_t len = strcspn(text, ",");
    const struct vs_preset *preset;

    for (preset = vs_presets; preset->name != NULL; preset++)
        if (strlen(preset->name) == len && memcmp(preset->name, text, len) == 0 &&
            vs_format(expanded, size, "%s%s", preset->base, text + len) < size - 1)
            return expanded;
    return text;
}
