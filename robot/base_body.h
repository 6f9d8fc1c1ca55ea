/* SPDX-License-Identifier: MIT */
/* base_body.h - what the robots that one protocol may sit on differ in. Pure. */
#ifndef VS_BASE_BODY_H
#define VS_BASE_BODY_H

#include <stdint.h>

#define VS_EPUCK_STEP_NM 128805  /* 1000 steps a turn of a 41 mm wheel. Source: epuck.md 6 */
#define VS_EPUCK2_STEP_NM 125664 /* 1000 steps a turn of a 40 mm wheel. Source: epuck.md 6 */

struct vs_base_body {
    int16_t max_steps_s; /* [step/s] what its motors can do */
    uint32_t step_nm;    /* [nm] way of a wheel per step */
};

extern const struct vs_base_body vs_body_epuck;
extern const struct vs_base_body vs_body_epuck2;

/* A speed limited to +-max_steps_s. */
static inline int16_t vs_base_clamp(int16_t steps_s, int16_t max_steps_s)
{
    if (steps_s > max_steps_s)
        return max_steps_s;
    return steps_s < -max_steps_s ? (int16_t)-max_steps_s : steps_s;
}

#endif
