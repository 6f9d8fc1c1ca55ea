/* SPDX-License-Identifier: MIT */
/* base_config.h - the text of --base, KIND:DEVICE[,OPTION[=VALUE]]..., read into a struct. Pure. */
#ifndef VS_BASE_CONFIG_H
#define VS_BASE_CONFIG_H

#include "base.h"

#define VS_BASE_CHOICES 2 /* options of its own that a kind of base may have */

struct vs_base_config {
    const struct vs_base_ops *ops;
    char device[VS_BASE_DEVICE_MAX + 1];
    char board[VS_BOARDS][VS_BASE_DEVICE_MAX + 1]; /* bus of each, "" = not there */
    uint8_t rab_bytes;                             /* of a message: 2 or 4 */
    uint8_t rab_power;                             /* of transmission, 0 full .. 255 */
    float rab_k_cm;                                /* [cm] range constant of its board */
    uint8_t choice[VS_BASE_CHOICES];               /* index of the chosen value */
    char reset[VS_BASE_DEVICE_MAX + 1];            /* name of the GPIO, "" = none */
};

/* Reads such a text. 0, or -1 and a phrase that says what was expected. */
int vs_base_configure(struct vs_base_config *config, const char *text, char *expected, size_t size);

#endif
