/* SPDX-License-Identifier: MIT */
#include "vs_offer.h"

#include <string.h>

int vs_session_offer(struct vs_session *s, const struct vs_welcome *w)
{
    if (w->params_len > VS_PARAMS_ROOM)
        return VS_ERR_SPACE;
    if (s->offer == 0 || s->table.hash != w->table.hash ||
        strlen(s->params) != w->params_len || memcmp(s->params, w->params, w->params_len) != 0)
        s->offer++;
    s->table = w->table;
    memcpy(s->params, w->params, w->params_len);
    s->params[w->params_len] = '\0';
    s->seed = w->seed;
    s->timestep_ns = (uint64_t)w->timestep_us * 1000;
#ifndef VS_SMALL /* software for double takes 2 kB */
    s->timestep_s = (double)s->timestep_ns / 1e9;
#endif
    s->phase = VS_PHASE_OPEN;
    s->open = 1;
    return VS_OK;
}
