/* SPDX-License-Identifier: MIT */
#include "base.h"

#include <string.h>

const struct vs_base_ops *const vs_bases[] = {&vs_base_argos, NULL};

const struct vs_base_ops *vs_base_find(const char *text, const char **device)
{
    const char *colon = strchr(text, ':');
    size_t i;

    if (colon == NULL || colon[1] == '\0')
        return NULL;
    for (i = 0; vs_bases[i] != NULL; i++) {
        size_t len = strlen(vs_bases[i]->name);

        if (len == (size_t)(colon - text) && memcmp(text, vs_bases[i]->name, len) == 0) {
            *device = colon + 1;
            return vs_bases[i];
        }
    }
    return NULL;
}
