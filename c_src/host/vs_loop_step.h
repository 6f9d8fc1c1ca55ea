/* SPDX-License-Identifier: MIT */
/* vs_loop_step.h - what vs_sim.c asks of loop functions. */
#ifndef VS_LOOP_STEP_H
#define VS_LOOP_STEP_H

#include "vs_loop.h"

/* Calls a function in a timestep with a clock; VS_OK where it says nothing, or VS_LOOP_... */
int vs_loop_step(struct vs_loop *loop, uint32_t function, uint32_t timestep, uint32_t clock);

#endif
