/* SPDX-License-Identifier: MIT */
/* vs_offer.h - a session's table and parameters, for vs_session.c and for who runs a controller
 * without a link (robot/inprocess.c). Internal to libvsense. */
#ifndef VS_OFFER_H
#define VS_OFFER_H

#include "vs_session.h"

/*
 * Takes what a WELCOME offers and opens the session with it, its link apart. Errors:
 * VS_ERR_SPACE (params longer than VS_PARAMS_ROOM; nothing has changed).
 */
int vs_session_offer(struct vs_session *s, const struct vs_welcome *w);

#endif
