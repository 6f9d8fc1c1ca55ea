/* SPDX-License-Identifier: MIT */
#include "guard_process.h"

#include <errno.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>

#include "driver.h"
#include "signals.h"
#include "watchdog.h"
#include "../c_src/vs_posix.h"

#define RETRY_NS 15000000u /* [ns] between two tries on a base that failed */
#define BREATH_NS 1000000u /* [ns] from one step of a try to the next */
#define NEAR_NS 60000000u  /* [ns] a deadline nearer than this is waited for by the clock of now */
#define PATIENCE_US 60000  /* [us] longest wait in recv(): the worker says something each 50 ms */

struct process {
    struct vs_guard guard;
    struct vs_base *base;
    int socket;
    int signals_fd;
    int patient;      /* recv() on the socket waits, at the longest PATIENCE_US */
    int result;       /* newest result of the base */
    unsigned int refused;
    const char *told; /* of the base's news */
    struct vs_guard_rest *rest;
};

/* Drops the oldest line. */
static void drop_line(struct vs_guard_rest *rest)
{
    rest->count--;
    memmove(rest->news, rest->news + 1, rest->count * sizeof *rest->news);
}

/* A base that fails in the same way again is no news. */
static void keep_news(struct process *p)
{
    const char *news = p->base->news;

    p->base->news = NULL;
    if (news == NULL || news == p->told)
        return;
    p->told = news;
    if (p->rest->count == VS_GUARD_KEPT)
        drop_line(p->rest);
    p->rest->news[p->rest->count++] = news;
}

static void perform(struct process *p, enum vs_guard_action action)
{
    struct vs_guard *g = &p->guard;

    vs_driver_until(p->base, vs_guard_deadline_ns(g));
    if (action == VS_GUARD_EXCHANGE)
        p->result = vs_base_exchange(p->base, &g->command, &g->reading);
    else if (action == VS_GUARD_RECOVER)
        p->result = vs_base_recover(p->base);
    else if (action == VS_GUARD_HAND_BACK)
        p->result = p->base->ops->close(p->base);
    else
        return;
    vs_guard_done(g, p->result, vs_posix_recent_ns());
    keep_news(p);
}

static void tell(struct process *p)
{
    struct vs_guard_reply reply;

    if (!vs_guard_reply(&p->guard, &reply))
        return;
    reply.base_resets = p->base->resets;
    reply.refused = (uint8_t)p->refused;
    reply.news = p->rest->count > 0 ? p->rest->news[0] : NULL;
    if (send(p->socket, &reply, VS_GUARD_REPLY_SIZE, MSG_NOSIGNAL | MSG_DONTWAIT) !=
        (ssize_t)VS_GUARD_REPLY_SIZE)
        vs_guard_orphaned(&p->guard, vs_posix_recent_ns());
    else if (reply.news != NULL)
        drop_line(p->rest);
}

/*
 * How long to wait at first, and since when. The worker that was just answered may have had the
 * processor since the clock was read, and while wheels turn no wait may be longer for that. Mostly
 * a request comes long before the deadline: then half of the wait costs no reading of the clock.
 */
static uint64_t until(uint64_t deadline_ns, uint64_t *now_ns)
{
    *now_ns = vs_posix_recent_ns();
    if (deadline_ns <= *now_ns || deadline_ns == UINT64_MAX)
        return deadline_ns;
    if (deadline_ns - *now_ns > NEAR_NS)
        return *now_ns + (deadline_ns - *now_ns) / 2;
    *now_ns = vs_posix_now_ns();
    return deadline_ns;
}

/* As hear() below, in one system call: a signal that comes just before it is heard after it. */
static void hear_in_one(struct process *p)
{
    struct vs_guard_request request;
    ssize_t len = recv(p->socket, &request, sizeof request, 0);
    int why = errno;
    uint64_t now_ns = vs_posix_now_ns();

    if (len == (ssize_t)sizeof request)
        vs_guard_request(&p->guard, &request, now_ns);
    else if (len >= 0 || (why != EAGAIN && why != EINTR))
        vs_guard_orphaned(&p->guard, now_ns);
    if (vs_signals_told())
        vs_guard_end(&p->guard, now_ns);
}

/* 1 if there is time for that, even if the clock was read some time ago. */
static int may_wait_in_one(const struct process *p, uint64_t deadline_ns)
{
    uint64_t now_ns = vs_posix_recent_ns();

    return p->patient && !vs_signals_told() && vs_guard_listens(&p->guard) &&
           deadline_ns > now_ns && deadline_ns - now_ns >= 2 * PATIENCE_US * UINT64_C(1000);
}

/* Waits until deadline_ns for what the worker, or a signal, says. At the end neither matters
 * any more, and what is ready for ever would keep the wait from being one. */
static void hear(struct process *p, uint64_t deadline_ns)
{
    struct vs_guard *g = &p->guard;
    struct pollfd fds[2] = {{g->ending ? -1 : p->socket, 0, 0},
                            {g->ending ? -1 : p->signals_fd, POLLIN, 0}};
    struct vs_guard_request request;
    uint64_t now_ns;
    int ready;

    if (may_wait_in_one(p, deadline_ns)) {
        hear_in_one(p);
        return;
    }
    if (vs_guard_listens(g))
        fds[0].events = POLLIN;
    deadline_ns = until(deadline_ns, &now_ns);
    ready = poll(fds, 2, vs_posix_timeout_ms(now_ns, deadline_ns));
    now_ns = vs_posix_now_ns();
    if (ready <= 0)
        return;
    if (fds[0].revents & (POLLHUP | POLLERR | POLLNVAL))
        vs_guard_orphaned(g, now_ns);
    else if ((fds[0].revents & POLLIN) &&
             recv(p->socket, &request, sizeof request, MSG_DONTWAIT) ==
                 (ssize_t)sizeof request)
        vs_guard_request(g, &request, now_ns);
    if (fds[1].revents)
        vs_guard_end(g, now_ns);
}

static enum vs_guard_action next(struct process *p)
{
    return vs_guard_next(&p->guard, vs_posix_recent_ns());
}

/* Until when to leave a base alone that did not do as told. Whatever it does, and however fast
 * it fails, a guard that goes before all other processes lets them run. */
static uint64_t pause_until_ns(const struct process *p, uint64_t began_ns)
{
    if (p->result == VS_OK)
        return 0;
    if (p->result == VS_ERR_IO || p->result == VS_ERR_SILENT)
        return vs_posix_recent_ns() + RETRY_NS;
    return began_ns + BREATH_NS;
}

/* Does what is to be done now. Returns until when to wait. */
static uint64_t act(struct process *p, enum vs_guard_action action)
{
    uint64_t began_ns = vs_posix_recent_ns();

    perform(p, action);
    tell(p);
    /* Mostly nothing more is to be done, and nobody need be heard before that is known. */
    if (action != VS_GUARD_WAIT && p->result == VS_OK)
        action = next(p);
    if (action == VS_GUARD_WAIT)
        return vs_guard_deadline_ns(&p->guard);
    return pause_until_ns(p, began_ns);
}

int vs_guard_process(int socket, int signals_fd, struct vs_base *base, int found,
                     unsigned int refused, struct vs_guard_rest *rest)
{
    struct process p = {.base = base, .socket = socket, .signals_fd = signals_fd};
    const struct timeval patience = {0, PATIENCE_US};
    enum vs_guard_action action;

    memset(rest, 0, sizeof *rest);
    p.refused = refused;
    p.rest = rest;
    p.patient = setsockopt(socket, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience) == 0;
    vs_guard_init(&p.guard, found);
    while ((action = next(&p)) != VS_GUARD_EXIT) {
        vs_watchdog_feed(vs_posix_recent_ns());
        hear(&p, act(&p, action));
    }
    while (vs_reset_lasts(&base->reset, vs_posix_recent_ns()))
        continue; /* nobody else would let go of the microcontroller */
    tell(&p);
    rest->hung = p.guard.hung;
    rest->stopped = p.guard.stopped;
    if (p.result == VS_ERR_HANGUP)
        return VS_GUARD_GONE;
    return p.guard.stopped ? VS_GUARD_STOPPED : VS_GUARD_UNSURE;
}
