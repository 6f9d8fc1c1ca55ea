/* SPDX-License-Identifier: MIT */
/* wiggle.h - a robot turns a little, which shows that its wheels do what they are told. */
#ifndef VS_WIGGLE_H
#define VS_WIGGLE_H

#include "base.h"

#define VS_WIGGLE_STEPS_S 200 /* each wheel: 26 mm/s */
#define VS_WIGGLE_LEAST 40    /* [step] of a way that count as turning */

/* Half a second to the left on its place, as long back, then it rests. VS_OK, with the steps of both
 * wheels on the first way; or how the base failed: its wheels may turn then, until it is closed. */
int vs_wiggle(struct vs_base *base, struct vs_base_reading *reading, int32_t way[2]);

#endif
