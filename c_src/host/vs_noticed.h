/* SPDX-License-Identifier: MIT */
/* vs_noticed.h - what a robot notices of others: a short list in the order of some key. */
#ifndef VS_NOTICED_H
#define VS_NOTICED_H

#include <stdint.h>

struct vs_noticed {
    uint32_t who;
    double key;
    double distance_m;
    double bearing_rad;
    double drawn; /* scratch of those who disturb it */
};

/* Puts one where it belongs among the `most` least keys, of which there are count; of equal keys
 * the first stays it. Gives how many there are now. */
uint32_t vs_notice(struct vs_noticed *list, uint32_t count, uint32_t most,
                   const struct vs_noticed *one);

#endif
