/* SPDX-License-Identifier: MIT */
#include "vs_noticed.h"

uint32_t vs_notice(struct vs_noticed *list, uint32_t count, uint32_t most,
                   const struct vs_noticed *one)
{
    uint32_t at = count < most ? count : most;

    while (at > 0 && list[at - 1].key > one->key)
        at--;
    if (at == most)
        return count;
    count += count < most;
    for (most = count - 1; most > at; most--)
        list[most] = list[most - 1];
    list[at] = *one;
    return count;
}
