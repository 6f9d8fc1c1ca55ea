/* SPDX-License-Identifier: MIT */
#include "guard_process.h"

#include <errno.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/time.h>

#include "report.h"
#include "signals.h"
#include "../c_src/vs_posix.h"

#define RETRY_NS 15000000u /* [ns] between two tries on a device that fails at once */
#define NEAR_NS 60000000u  /* [ns] a deadline nearer than this is waited for by the clock of now */
#define PATIENCE_US 60000  /* [us] longest wait in recv(): the worker says something each 50 ms */

struct process {
    struct vs_guard guard;
    struct vs_base *base;
    int socket;
    int signals_fd;
    int patient;      /* recv() on the socket waits, at the longest PATIENCE_US */
    int result;       /* newest result of the base */
    const char *told; /* of the base's news */
};

/* A base that fails in the same way again is no news. */
static void pass_on(struct process *p)
{
    if (p->base->news != NULL && p->base->news != p->told) {
        vs_report("base: %s", p->base->news);
        p->told = p->base->news;
    }
    p->base->news = NULL;
}

static void perform(struct process *p, enum vs_guard_action action)
{
    struct vs_guard *g = &p->guard;

    if (action == VS_GUARD_EXCHANGE)
        p->result = vs_base_exchange(p->base, &g->command, &g->reading);
    else if (action == VS_GUARD_RECOVER)
        p->result = vs_base_recover(p->base);
    else if (action == VS_GUARD_HAND_BACK)
        p->result = p->base->ops->close(p->base);
    else
        return;
    vs_guard_done(g, p->result, vs_posix_recent_ns());
    pass_on(p);
}

/* Nothing is asked for. Returns until when to wait. */
static uint64_t rest(struct process *p)
{
    int more = vs_base_rest(p->base, &p->guard.command);

    pass_on(p);
    return more ? 0 : vs_guard_deadline_ns(&p->guard);
}

static void tell(struct process *p)
{
    struct vs_guard_reply reply;

    if (vs_guard_reply(&p->guard, &reply) &&
        send(p->socket, &reply, sizeof reply, MSG_NOSIGNAL | MSG_DONTWAIT) !=
            (ssize_t)sizeof reply)
        vs_guard_orphaned(&p->guard, vs_posix_recent_ns());
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

/* Waits until deadline_ns for what the worker, or a signal, says. */
static void hear(struct process *p, uint64_t deadline_ns)
{
    struct vs_guard *g = &p->guard;
    struct pollfd fds[2] = {{p->socket, 0, 0}, {p->signals_fd, POLLIN, 0}};
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

/* Does what is to be done now. Returns until when to wait. */
static uint64_t act(struct process *p, enum vs_guard_action action)
{
    perform(p, action);
    tell(p);
    /* Mostly nothing more is to be done, and nobody need be heard before that is known. */
    if (action != VS_GUARD_WAIT && p->result == VS_OK)
        action = next(p);
    if (action == VS_GUARD_WAIT)
        return rest(p);
    return p->result == VS_ERR_IO ? vs_posix_recent_ns() + RETRY_NS : 0;
}

int vs_guard_process(int socket, int signals_fd, struct vs_base *base, int found)
{
    struct process p = {.base = base, .socket = socket, .signals_fd = signals_fd};
    const struct timeval patience = {0, PATIENCE_US};
    enum vs_guard_action action;

    p.patient = setsockopt(socket, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience) == 0;
    vs_guard_init(&p.guard, found);
    while ((action = next(&p)) != VS_GUARD_EXIT)
        hear(&p, act(&p, action));
    tell(&p);
    if (p.result == VS_ERR_HANGUP)
        return VS_GUARD_GONE;
    return p.guard.stopped ? VS_GUARD_STOPPED : VS_GUARD_UNSURE;
}
