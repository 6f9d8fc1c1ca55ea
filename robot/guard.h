/* SPDX-License-Identifier: MIT */
/*
 * guard.h - the guard's mind: when may the wheels turn, and what has to be written
 * to the base next? Pure: events and times in, actions out, so that a test can
 * explore every order of requests, expiries, failures and deaths on virtual time.
 * guard_process.h runs it in a process of its own.
 *
 *   next = vs_guard_next(g, now)      what to do with the base now
 *   vs_guard_done(g, result, now)     how that went
 *   vs_guard_reply(g, &reply)         1: send this to the worker
 *   vs_guard_deadline_ns(g)           wait for requests no longer than this
 *
 * Wheels turn only before the earlier of the newest command's expiry and
 * VS_GUARD_BEAT_NS after it (a command is a beat: the worker completed a control
 * step). Only a newer command can turn them again. Every request is answered once.
 * A stop counts only when the base has answered it: the line has no checksum, so a
 * frame that lost a byte is written, but not applied. Until then it is due.
 * A worker that asks nothing for VS_GUARD_HUNG_NS is given up like one that is gone.
 * Times are of the board's clock [ns], the same for worker and guard.
 */
#ifndef VS_GUARD_H
#define VS_GUARD_H

#include "base.h"
#include "../c_src/vs_body.h"

#define VS_GUARD_BEAT_NS 250000000u /* [ns] a control step must follow within this */
#define VS_GUARD_END_NS 1000000000u /* [ns] longest try to stop a base at the end */
#define VS_GUARD_HUNG_NS UINT64_C(3000000000) /* [ns] a worker that asks nothing hangs */

enum vs_guard_kind {
    VS_GUARD_PING = 0,  /* answered without touching the base */
    VS_GUARD_SENSE = 1, /* exchange with what is commanded now: a fresh reading */
    VS_GUARD_ACT = 2,   /* a completed control step: command, expiry */
    VS_GUARD_CLOSE = 3  /* wheels 0, LEDs off; once answered hand the base back, end */
};

/* Both structs travel between two processes of the same binary, as they are. */
struct vs_guard_request {
    uint32_t kind;                  /* enum vs_guard_kind */
    uint32_t number;                /* echoed */
    struct vs_base_command command; /* ACT only */
    uint64_t expiry_ns;             /* ACT only: speeds are 0 from then on */
};

struct vs_guard_reply {
    uint32_t number;                /* of the request */
    int32_t result;                 /* of its exchange: VS_OK, VS_ERR_*; PING VS_OK */
    uint8_t kind;                   /* of the request */
    uint8_t cause;                  /* enum vs_stop_cause: why the guard holds speed 0 */
    uint8_t sensed;                 /* reading is new */
    uint8_t lost;                   /* the base is being searched for */
    uint32_t base_errors;           /* since this guard began */
    uint32_t base_resets;           /* since the daemon began; of guard_process.h */
    struct vs_base_command command; /* in force now */
    uint64_t reading_ns;            /* when it came, 0 = none yet */
    const char *news;               /* a line for the log, NULL = none: a phrase of the program */
    uint8_t refused;                /* what the system refused the guard: guard_rights.h */
    struct vs_base_reading reading; /* up to VS_BASE_OWN bytes; zeros unless sensed */
};

#define VS_GUARD_REPLY_SIZE (offsetof(struct vs_guard_reply, reading) + VS_BASE_OWN) /* sent */

enum vs_guard_action {
    VS_GUARD_WAIT = 0,     /* nothing until a request or the deadline */
    VS_GUARD_EXCHANGE = 1, /* base exchange with g->command, reading to g->reading */
    VS_GUARD_RECOVER = 2,  /* one step of base recovery */
    VS_GUARD_HAND_BACK = 3,/* base close */
    VS_GUARD_EXIT = 4      /* end the process; g->stopped says how */
};

/* Read-only for the caller but for reading, which an exchange writes. */
struct vs_guard {
    struct vs_base_command command; /* what the base should be doing */
    struct vs_base_reading reading;
    uint64_t reading_ns;
    uint64_t expiry_ns;
    uint64_t beat_ns;
    uint64_t heard_ns;    /* newest request, 0 = none yet */
    uint64_t end_ns;      /* ending: give up then */
    uint32_t base_errors;
    uint8_t cause;        /* enum vs_stop_cause */
    uint8_t lost;         /* the base has to be recovered */
    uint8_t due;          /* an exchange is due: command not written, or a reading wanted */
    uint8_t ending;       /* 0, 1: the worker is gone or hangs, 2: close */
    uint8_t hung;         /* 1: the worker hangs, and has to be ended before the guard ends */
    uint8_t over;         /* EXIT is next */
    uint8_t stopped;      /* at EXIT: 1 = the base surely stands still */
    uint8_t action;       /* enum vs_guard_action given by vs_guard_next */
    uint8_t answer;       /* a request waits for its reply */
    struct vs_guard_request request;
    uint8_t reply_due;
    uint8_t sensed;       /* for the reply */
    int result;
};

/* Begins with wheels at 0. found: the base was just recovered; else that is first. */
void vs_guard_init(struct vs_guard *g, int found);

/* A request of the worker. Only while vs_guard_listens. */
void vs_guard_request(struct vs_guard *g, const struct vs_guard_request *request,
                      uint64_t now_ns);

/* 1 if the guard can take a request now. */
int vs_guard_listens(const struct vs_guard *g);

/* The worker is gone. */
void vs_guard_orphaned(struct vs_guard *g, uint64_t now_ns);

/* The guard was told to end: as a CLOSE without an answer. */
void vs_guard_end(struct vs_guard *g, uint64_t now_ns);

/* What to do now; the deadline is looked at here. */
enum vs_guard_action vs_guard_next(struct vs_guard *g, uint64_t now_ns);

/* How the action that vs_guard_next gave went (VS_GUARD_EXCHANGE, _RECOVER,
 * _HAND_BACK): what the base's function returned. */
void vs_guard_done(struct vs_guard *g, int result, uint64_t now_ns);

/* Gives each reply once: 1 and *reply, or 0. */
int vs_guard_reply(struct vs_guard *g, struct vs_guard_reply *reply);

/* When vs_guard_next has to be called at the latest, UINT64_MAX if never. */
uint64_t vs_guard_deadline_ns(const struct vs_guard *g);

#endif
