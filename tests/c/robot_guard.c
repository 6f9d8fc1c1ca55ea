/* SPDX-License-Identifier: MIT */
/*
 * The guard's mind, explored to the end: from its first moment every order of
 * requests, expiries, late and failing bases, deaths and signals on virtual time,
 * until no new state turns up. An independent model says when wheels may turn.
 * Prints how many states there are.
 */
#include <string.h>

#include "check.h"
#include "guard.h"

#define STEP_NS 10000000u /* [ns] grid of virtual time */
#define MOVE 500
#define TABLE_SIZE (1u << 19)
#define STACK_SIZE (1u << 16)

enum wheels { STILL, TURNING, ANYTHING };

struct world {
    struct vs_guard guard;
    uint64_t now_ns;
    /* the model */
    uint64_t until_ns;     /* wheels may turn before this, 0 = not */
    uint64_t ends_ns;      /* asked, orphaned or hung then, 0 = not yet */
    uint64_t heard_ns;     /* the worker gave a sign of life */
    enum wheels base;      /* what the base does */
    int closing;           /* the end is a CLOSE: the base has to be handed back */
    int handed;
    int asked;             /* a request has no answer yet */
    uint32_t kind;
    int over;
};

struct key {
    uint8_t turning, cause, lost, due, ending, over, stopped, answer, reply_due, base, asked, kind;
    uint8_t until, expiry, beat, end, ends, closing, handed, hung;
};

static struct key seen[TABLE_SIZE];
static uint8_t used[TABLE_SIZE];
static struct world stack[STACK_SIZE];
static uint32_t depth;
static uint32_t states;
static uint32_t hangs;

static uint8_t ahead(uint64_t at_ns, uint64_t now_ns)
{
    return at_ns > now_ns ? (uint8_t)((at_ns - now_ns) / STEP_NS + 1) : 0;
}

static struct key key_of(const struct world *w)
{
    const struct vs_guard *g = &w->guard;
    struct key key;

    memset(&key, 0, sizeof key);
    key.turning = g->command.left_steps_s != 0;
    key.cause = g->cause;
    key.lost = g->lost;
    key.due = g->due;
    key.ending = g->ending;
    key.over = g->over;
    key.stopped = g->stopped;
    key.answer = g->answer;
    key.reply_due = g->reply_due;
    key.base = (uint8_t)w->base;
    key.asked = (uint8_t)w->asked;
    key.kind = w->asked ? (uint8_t)w->kind : 0;
    key.until = ahead(w->until_ns, w->now_ns);
    key.expiry = ahead(g->expiry_ns, w->now_ns);
    key.beat = ahead(g->beat_ns + VS_GUARD_BEAT_NS, w->now_ns);
    key.end = g->ending ? ahead(g->end_ns, w->now_ns) : 0;
    key.ends = w->ends_ns != 0;
    key.closing = (uint8_t)w->closing;
    key.handed = (uint8_t)w->handed;
    key.hung = (uint8_t)(g->hung + 2 * (w->now_ns >= w->heard_ns + VS_GUARD_HUNG_NS));
    return key;
}

static uint32_t hash_of(const struct key *key)
{
    const uint8_t *bytes = (const uint8_t *)key;
    uint32_t hash = 2166136261u;
    size_t i;

    for (i = 0; i < sizeof *key; i++)
        hash = (hash ^ bytes[i]) * 16777619u;
    return hash % TABLE_SIZE;
}

/* Keeps a world for later unless one like it was seen. */
static void keep(const struct world *w)
{
    struct key key = key_of(w);
    uint32_t at = hash_of(&key);

    while (used[at]) {
        if (memcmp(&seen[at], &key, sizeof key) == 0)
            return;
        at = (at + 1) % TABLE_SIZE;
    }
    used[at] = 1;
    seen[at] = key;
    states++;
    CHECK(states < TABLE_SIZE / 2 && depth < STACK_SIZE);
    stack[depth++] = *w;
}

static int may_turn(const struct world *w)
{
    return w->ends_ns == 0 && w->now_ns < w->until_ns;
}

static void take_reply(struct world *w)
{
    struct vs_guard_reply reply;

    if (!vs_guard_reply(&w->guard, &reply))
        return;
    CHECK(w->asked);
    CHECK(reply.kind == w->kind && reply.number == 7);
    CHECK(reply.kind != VS_GUARD_CLOSE || reply.result != VS_OK || w->handed);
    w->asked = 0;
    CHECK(!vs_guard_reply(&w->guard, &reply));
}

static void ask(const struct world *from, uint32_t kind, int16_t speed, uint64_t expiry_ns)
{
    struct world w = *from;
    struct vs_guard_request request = {kind, 7, {speed, (int16_t)-speed, 1, {0, {0}}, {{0}}},
                                       expiry_ns};

    if (!vs_guard_listens(&w.guard))
        return;
    CHECK(!w.asked);
    w.asked = 1;
    w.heard_ns = w.now_ns;
    w.kind = kind;
    if (kind == VS_GUARD_ACT && !w.guard.lost) {
        uint64_t beat_ns = w.now_ns + VS_GUARD_BEAT_NS;

        w.until_ns = speed == 0 ? 0 : expiry_ns < beat_ns ? expiry_ns : beat_ns;
    }
    if (kind == VS_GUARD_CLOSE) {
        w.ends_ns = w.now_ns;
        w.closing = 1;
    }
    vs_guard_request(&w.guard, &request, w.now_ns);
    take_reply(&w);
    keep(&w);
}

static void end(const struct world *from, void (*event)(struct vs_guard *, uint64_t))
{
    struct world w = *from;

    if (w.ends_ns == 0) {
        w.ends_ns = w.now_ns;
        w.closing = event == vs_guard_end;
    }
    event(&w.guard, w.now_ns);
    take_reply(&w);
    keep(&w);
}

static void sleep_for(const struct world *from, uint32_t steps)
{
    struct world w = *from;
    uint64_t deadline_ns = vs_guard_deadline_ns(&w.guard);
    uint64_t wake_ns = w.now_ns + steps * STEP_NS;

    /* poll() would have ended at the deadline */
    w.now_ns = deadline_ns < wake_ns && deadline_ns > w.now_ns ? deadline_ns : wake_ns;
    keep(&w);
}

/* What the base does after an action that the guard knows the result of. Written is not
 * applied: what nobody answered may have lost a byte, so that the old speed goes on. */
static enum wheels effect(const struct world *w, uint8_t action, int result, int applied)
{
    int turning = action == VS_GUARD_EXCHANGE && w->guard.command.left_steps_s != 0;
    int answered = result == VS_OK && action != VS_GUARD_HAND_BACK;
    int written = result == VS_OK || (result == VS_ERR_LATE && action != VS_GUARD_RECOVER);

    if (answered || (written && applied))
        return turning ? TURNING : STILL;
    return written || result == VS_ERR_BUSY ? w->base : ANYTHING;
}

/* The base did as told (applied), or something else. */
static void done(const struct world *from, int result, uint32_t steps, int applied)
{
    struct world w = *from;
    uint8_t action = w.guard.action;

    w.now_ns += steps * STEP_NS;
    w.base = effect(from, action, result, applied);
    w.handed = w.handed || (action == VS_GUARD_HAND_BACK && result == VS_OK);
    if (action == VS_GUARD_EXCHANGE && result != VS_OK && result != VS_ERR_LATE &&
        result != VS_ERR_BUSY)
        w.until_ns = 0; /* a base that was lost needs a newer command */
    vs_guard_done(&w.guard, result, w.now_ns);
    take_reply(&w);
    keep(&w);
}

static void check_wait(const struct world *w)
{
    CHECK(w->ends_ns == 0);
    CHECK(!w->asked);
    CHECK(w->base == STILL || (may_turn(w) && w->base == TURNING));
    if (w->base == TURNING)
        CHECK(vs_guard_deadline_ns(&w->guard) == w->until_ns);
}

static void check_exit(const struct world *w)
{
    CHECK(!w->asked || w->guard.reply_due);
    if (w->guard.stopped)
        CHECK(w->base == STILL && (w->handed || !w->closing));
}

static void every_request(const struct world *w)
{
    ask(w, VS_GUARD_PING, 0, 0);
    ask(w, VS_GUARD_SENSE, 0, 0);
    ask(w, VS_GUARD_ACT, 0, w->now_ns + 40 * STEP_NS);
    ask(w, VS_GUARD_ACT, MOVE, w->now_ns + 40 * STEP_NS);
    ask(w, VS_GUARD_ACT, MOVE, w->now_ns + 8 * STEP_NS);
    ask(w, VS_GUARD_ACT, MOVE, w->now_ns);
    ask(w, VS_GUARD_CLOSE, 0, 0);
    end(w, vs_guard_orphaned);
    end(w, vs_guard_end);
}

/* Only a worker that could ask, and did not, hangs; then all is as if it were gone. */
static void check_hung(struct world *w)
{
    int silent = w->now_ns >= w->heard_ns + VS_GUARD_HUNG_NS;

    if (w->ends_ns != 0)
        return;
    CHECK(w->guard.hung == silent);
    if (silent)
        w->ends_ns = w->now_ns;
    hangs += (uint32_t)silent;
}

static void explore(const struct world *from)
{
    static const int results[] = {VS_OK, VS_ERR_BUSY, VS_ERR_LATE, VS_ERR_SILENT,
                                  VS_ERR_GARBLED, VS_ERR_IO, VS_ERR_HANGUP};
    struct world w = *from;
    enum vs_guard_action action = vs_guard_next(&w.guard, w.now_ns);
    size_t i;

    check_hung(&w);
    if (w.ends_ns != 0 && w.now_ns >= w.ends_ns + VS_GUARD_END_NS)
        CHECK(action == VS_GUARD_EXIT);
    if (action == VS_GUARD_EXCHANGE)
        CHECK(may_turn(&w) || w.guard.command.left_steps_s == 0);
    if (action == VS_GUARD_WAIT)
        check_wait(&w);
    if (action == VS_GUARD_EXIT) {
        take_reply(&w);
        check_exit(&w);
        return;
    }
    if (action == VS_GUARD_WAIT) {
        sleep_for(&w, 1);
        sleep_for(&w, 3);
        sleep_for(&w, 400);
    } else {
        for (i = 0; i < sizeof results / sizeof results[0]; i++) {
            if (action == VS_GUARD_RECOVER && results[i] == VS_ERR_LATE)
                continue;
            done(&w, results[i], 0, 1);
            done(&w, results[i], 1, 1);
            done(&w, results[i], 0, 0);
            if (action == VS_GUARD_RECOVER) /* so long that a silent worker hangs meanwhile */
                done(&w, results[i], 400, 1);
        }
    }
    w.guard.action = VS_GUARD_WAIT;
    every_request(&w);
}

/* Of however little it asks. */
static void test_a_worker_that_asks_does_not_hang(void)
{
    struct vs_guard_request ping = {.kind = VS_GUARD_PING, .number = 1};
    struct vs_guard_reply reply;
    struct vs_guard guard;
    uint64_t now_ns = STEP_NS;
    int i;

    vs_guard_init(&guard, 1);
    CHECK(vs_guard_next(&guard, now_ns) == VS_GUARD_WAIT);
    for (i = 0; i < 5; i++) {
        now_ns += VS_GUARD_HUNG_NS - 1;
        CHECK(vs_guard_next(&guard, now_ns) == VS_GUARD_WAIT);
        vs_guard_request(&guard, &ping, now_ns);
        CHECK(vs_guard_reply(&guard, &reply) && reply.result == VS_OK);
        CHECK(vs_guard_deadline_ns(&guard) == now_ns + VS_GUARD_HUNG_NS);
    }
    now_ns += VS_GUARD_HUNG_NS;
    CHECK(vs_guard_next(&guard, now_ns) == VS_GUARD_EXCHANGE && guard.hung);
}

int main(void)
{
    struct world w;
    int found;

    test_a_worker_that_asks_does_not_hang();
    for (found = 0; found < 2; found++) {
        memset(&w, 0, sizeof w);
        w.now_ns = w.heard_ns = 20 * STEP_NS;
        w.base = found ? STILL : ANYTHING;
        vs_guard_init(&w.guard, found);
        keep(&w);
    }
    while (depth > 0) {
        w = stack[--depth];
        explore(&w);
    }
    printf("%u states\n", (unsigned int)states);
    CHECK(states > 1000 && hangs > 3);
    return 0;
}
