/* SPDX-License-Identifier: MIT */
/* talk.h - what the daemon says about its life, each thing once when it happens. */
#ifndef VS_TALK_H
#define VS_TALK_H

#include "loop.h"
#include "net.h"

#define VS_TALK_PATIENCE_NS 1000000000u /* [ns] a start may take before it is worth a word */

struct vs_talk {
    uint8_t cause;        /* enum vs_stop_cause said last */
    uint8_t free;         /* the wheels were free once */
    uint8_t connected;
    uint8_t refused;      /* rights of the guard, said */
    uint64_t since_ns;    /* the start waits since then */
    char refusal[VS_TEXT_MAX + 1];
};

/* An event of the session. */
void vs_talk_event(struct vs_talk *talk, enum vs_event event, const struct vs_session *session);

/* The connection ended. */
void vs_talk_lost(struct vs_talk *talk, const char *why);

/* The controller began a run: what the host offers and it did not ask for. */
void vs_talk_unused(const struct vs_robot *robot, const char *controller);

/* For vs_robot.complain: what the controller asked for in vain. */
void vs_talk_complain(void *context, const char *what, const char *name);

/* What the guard cannot say itself. */
void vs_talk_guard(struct vs_talk *talk, const struct vs_guard_reply *reply);

/* Whether wheels are held, and why. */
void vs_talk_cause(struct vs_talk *talk, enum vs_stop_cause cause, uint64_t now_ns);

#endif
