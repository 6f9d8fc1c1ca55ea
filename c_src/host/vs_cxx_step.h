/* SPDX-License-Identifier: MIT */
/* vs_cxx_step.h - what vs_sim.c asks of loop functions. */
#ifndef VS_CXX_STEP_H
#define VS_CXX_STEP_H

#include "vs_cxx.h"

/* Calls a function in a timestep with a clock; VS_OK where it says nothing, or VS_CXX_... */
int vs_cxx_step(struct vs_cxx *loop, uint32_t function, uint32_t timestep, uint32_t clock);

#endif
