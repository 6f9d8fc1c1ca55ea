/* SPDX-License-Identifier: MIT */
#include "guard.h"

#include <string.h>

#include "driver.h"
#include "leds.h"

enum { ENDING_ORPHANED = 1, ENDING_CLOSE = 2 };

static int moving(const struct vs_guard *g)
{
    return g->command.left_steps_s != 0 || g->command.right_steps_s != 0;
}

static void hold(struct vs_guard *g, uint8_t cause)
{
    g->command.left_steps_s = 0;
    g->command.right_steps_s = 0;
    g->cause = cause;
    g->due = 1;
}

void vs_guard_init(struct vs_guard *g, int found)
{
    memset(g, 0, sizeof *g);
    g->lost = !found;
    g->cause = found ? VS_CAUSE_NONE : VS_CAUSE_BASE;
    g->reading.battery_low = VS_UNKNOWN;
}

static void answer(struct vs_guard *g, int result, int sensed)
{
    if (!g->answer)
        return;
    g->result = result;
    g->sensed = (uint8_t)sensed;
    g->answer = 0;
    g->reply_due = 1;
}

static void begin_end(struct vs_guard *g, uint8_t ending, uint64_t now_ns)
{
    if (g->ending)
        return;
    g->ending = ending;
    g->end_ns = now_ns + VS_GUARD_END_NS;
    vs_leds_off(&g->command);
    hold(g, VS_CAUSE_SIGNAL);
}

static void act(struct vs_guard *g, uint64_t now_ns)
{
    g->command = g->request.command;
    g->expiry_ns = g->request.expiry_ns;
    g->beat_ns = now_ns;
    g->cause = VS_CAUSE_NONE;
    g->due = 1;
}

void vs_guard_request(struct vs_guard *g, const struct vs_guard_request *request,
                      uint64_t now_ns)
{
    g->request = *request;
    g->heard_ns = now_ns;
    g->answer = 1;
    switch (request->kind) {
    case VS_GUARD_CLOSE:
        begin_end(g, ENDING_CLOSE, now_ns);
        break;
    case VS_GUARD_ACT:
        if (g->lost)
            answer(g, VS_ERR_SILENT, 0);
        else
            act(g, now_ns);
        break;
    case VS_GUARD_SENSE:
        if (g->lost)
            answer(g, VS_ERR_SILENT, 0);
        else
            g->due = 1;
        break;
    default:
        answer(g, VS_OK, 0);
        break;
    }
}

int vs_guard_listens(const struct vs_guard *g)
{
    return !g->answer && !g->reply_due && !g->ending;
}

void vs_guard_orphaned(struct vs_guard *g, uint64_t now_ns)
{
    begin_end(g, ENDING_ORPHANED, now_ns);
}

void vs_guard_end(struct vs_guard *g, uint64_t now_ns)
{
    begin_end(g, ENDING_CLOSE, now_ns);
}

/* Until when wheels may turn. */
static uint64_t still_ns(const struct vs_guard *g)
{
    uint64_t beat_ns = g->beat_ns + VS_GUARD_BEAT_NS;

    if (!moving(g))
        return UINT64_MAX;
    return g->expiry_ns < beat_ns ? g->expiry_ns : beat_ns;
}

uint64_t vs_guard_deadline_ns(const struct vs_guard *g)
{
    uint64_t hung_ns = g->ending || g->heard_ns == 0 ? UINT64_MAX : g->heard_ns + VS_GUARD_HUNG_NS;

    return still_ns(g) < hung_ns ? still_ns(g) : hung_ns;
}

static void look_at_worker(struct vs_guard *g, uint64_t now_ns)
{
    if (g->heard_ns == 0)
        g->heard_ns = now_ns;
    if (g->ending || now_ns < g->heard_ns + VS_GUARD_HUNG_NS)
        return;
    begin_end(g, ENDING_ORPHANED, now_ns);
    g->hung = 1;
}

enum vs_guard_action vs_guard_next(struct vs_guard *g, uint64_t now_ns)
{
    if (now_ns >= still_ns(g))
        hold(g, now_ns >= g->expiry_ns ? VS_CAUSE_STALE : VS_CAUSE_NO_BEAT);
    look_at_worker(g, now_ns);
    if (g->ending && now_ns >= g->end_ns)
        g->over = 1;
    if (g->over) {
        answer(g, g->stopped ? VS_OK : VS_ERR_SILENT, 0);
        g->action = VS_GUARD_EXIT;
    } else if (g->lost) {
        g->action = VS_GUARD_RECOVER;
    } else if (g->due || g->ending == ENDING_ORPHANED) {
        g->action = VS_GUARD_EXCHANGE;
    } else if (g->ending == ENDING_CLOSE) {
        g->action = VS_GUARD_HAND_BACK;
    } else {
        g->action = VS_GUARD_WAIT;
    }
    return (enum vs_guard_action)g->action;
}

/* The base has to be searched for; what it does until it is found nobody knows. */
static void lose(struct vs_guard *g, int result)
{
    g->base_errors++;
    g->lost = 1;
    vs_leds_off(&g->command);
    hold(g, VS_CAUSE_BASE);
    g->due = 0;
    if (result == VS_ERR_HANGUP)
        g->over = 1;
    if (!g->ending)
        answer(g, result, 0);
}

static void exchanged(struct vs_guard *g, int result, uint64_t now_ns)
{
    if (result == VS_OK) {
        g->reading_ns = now_ns - vs_driver_age_ns(&g->reading);
        g->due = 0;
    } else if (result == VS_ERR_LATE) {
        /* written is not applied: a byte may be lost; only an answer proves a stop */
        g->due = (uint8_t)!moving(g);
    } else if (result != VS_ERR_BUSY) {
        lose(g, result);
        return;
    }
    if (g->ending == ENDING_ORPHANED && result == VS_OK) {
        g->stopped = 1;
        g->over = 1;
    }
    if (!g->ending)
        answer(g, result, result == VS_OK);
}

static void recovered(struct vs_guard *g, int result)
{
    if (result == VS_OK) {
        g->lost = 0;
        g->due = 0;
        g->stopped = g->ending == ENDING_ORPHANED;
        g->over = g->stopped;
        if (g->cause == VS_CAUSE_BASE)
            g->cause = VS_CAUSE_NONE;
    } else if (result == VS_ERR_HANGUP) {
        g->base_errors++;
        g->over = 1;
    } else if (result != VS_ERR_BUSY) {
        g->base_errors++;
    }
}

void vs_guard_done(struct vs_guard *g, int result, uint64_t now_ns)
{
    if (g->action == VS_GUARD_EXCHANGE) {
        exchanged(g, result, now_ns);
    } else if (g->action == VS_GUARD_RECOVER) {
        recovered(g, result);
    } else if (g->action == VS_GUARD_HAND_BACK && result == VS_OK) {
        g->stopped = 1;
        g->over = 1;
    } else if (g->action == VS_GUARD_HAND_BACK && result != VS_ERR_BUSY) {
        lose(g, result);
    }
    g->action = VS_GUARD_WAIT;
}

int vs_guard_reply(struct vs_guard *g, struct vs_guard_reply *reply)
{
    if (!g->reply_due)
        return 0;
    reply->number = g->request.number;
    reply->result = g->result;
    reply->kind = (uint8_t)g->request.kind;
    reply->cause = g->cause;
    reply->sensed = g->sensed;
    reply->lost = g->lost;
    reply->base_errors = g->base_errors;
    reply->command = g->command;
    reply->reading_ns = g->reading_ns;
    if (g->sensed)
        memcpy(&reply->reading, &g->reading, VS_BASE_OWN);
    else
        memset(&reply->reading, 0, VS_BASE_OWN);
    g->reply_due = 0;
    return 1;
}
