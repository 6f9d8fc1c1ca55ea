/* SPDX-License-Identifier: MIT */
#include "guard_process.h"

#include <errno.h>
#include <poll.h>
#include <sys/socket.h>

#include "report.h"
#include "watchdog.h"
#include "../c_src/vs_posix.h"

#define RETRY_NS 15000000u /* [ns] between two tries on a device that fails at once */

struct process {
    struct vs_guard guard;
    struct vs_base *base;
    int socket;
    int signals_fd;
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

/* Waits until deadline_ns for what the worker, or a signal, says. */
static void hear(struct process *p, uint64_t deadline_ns)
{
    struct vs_guard *g = &p->guard;
    struct pollfd fds[2] = {{p->socket, 0, 0}, {p->signals_fd, POLLIN, 0}};
    struct vs_guard_request request;
    uint64_t now_ns = vs_posix_recent_ns();
    int ready;

    if (vs_guard_listens(g))
        fds[0].events = POLLIN;
    /* The worker that was just answered may have had the processor since: while wheels turn no
     * wait is longer for that. */
    if (deadline_ns > now_ns && deadline_ns != UINT64_MAX)
        now_ns = vs_posix_now_ns();
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
    enum vs_guard_action action;

    vs_guard_init(&p.guard, found);
    while ((action = next(&p)) != VS_GUARD_EXIT) {
        vs_watchdog_feed(vs_posix_recent_ns());
        hear(&p, act(&p, action));
    }
    tell(&p);
    if (p.result == VS_ERR_HANGUP)
        return VS_GUARD_GONE;
    return p.guard.stopped ? VS_GUARD_STOPPED : VS_GUARD_UNSURE;
}
