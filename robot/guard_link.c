/* SPDX-License-Identifier: MIT */
#include "guard_link.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "guard_rights.h"
#include "report.h"
#include "restart.h"
#include "signals.h"
#include "../c_src/vs_posix.h"

#define STOP_NS 500000000u /* [ns] two whole recoveries */
#define END_TRIES 10       /* for a killed guard's end, 1 ms each */

/* A worker lets the guard hear of it, or has the same signal and ends. One that hangs would stay
 * for ever, with nobody to end it. */
static void outlast(int socket, long worker)
{
    struct pollfd word = {socket, POLLIN, 0};

    if (poll(&word, 1, vs_posix_timeout_ms(0, VS_GUARD_HUNG_NS)) == 0 &&
        vs_restart_end(worker, socket))
        vs_report("asked to end, but the worker hung: ended it");
}

/* The guard's last act, once nothing has to be guarded: now it may take time to say what
 * nobody has heard. What another daemon opens must not be held here meanwhile. */
static void leave(struct vs_guard_link *link, int socket, long worker,
                  const struct vs_guard_rest *rest)
{
    int ended = !rest->hung || vs_restart_end(worker, socket);
    size_t i;

    vs_posix_close_but(socket, -1);
    if (!rest->hung && vs_signals_told())
        outlast(socket, worker);
    for (i = 0; i < rest->count; i++)
        vs_report("base: %s", rest->news[i]);
    if (!rest->hung)
        return;
    vs_report("the worker hung for %d s: %s, %s", (int)(VS_GUARD_HUNG_NS / 1000000000u),
              rest->stopped ? "stopped the wheels" : "the base did not answer",
              ended ? "ended it" : "it cannot be ended");
    if (vs_restart_by_service())
        return;
    vs_restart(link->argv);
    vs_report("cannot start again: %s", vs_trouble(errno));
}

static void become_guard(struct vs_guard_link *link, int socket, int found, long worker)
{
    struct vs_guard_rest rest;
    int signals_fd;
    int status;
    size_t i;

    for (i = 0; i < link->foreign_count; i++)
        if (*link->foreign[i] >= 0)
            close(*link->foreign[i]);
    if (vs_signals_open(&signals_fd) != 0)
        _exit(VS_GUARD_UNSURE);
    vs_signals_stay_awake();
    vs_signals_unblock();
    status = vs_guard_process(socket, signals_fd, link->base, found,
                              vs_rights_take(link->spare, link->spare_len), &rest);
    leave(link, socket, worker, &rest);
    _exit(status);
}

int vs_guard_link_start(struct vs_guard_link *link, int found)
{
    long worker = getpid();
    int socket;
    long pid = vs_signals_fork(&socket);

    if (pid == 0)
        become_guard(link, socket, found, worker);
    if (pid < 0)
        return -1;
    link->pid = pid;
    link->socket = socket;
    link->waiting = 0;
    link->heard_ns = vs_posix_now_ns();
    link->status = -1;
    return 0;
}

void vs_guard_link_send(struct vs_guard_link *link, struct vs_guard_request *request)
{
    link->number++;
    request->number = link->number;
    link->waiting = 1;
    /* a request that cannot be sent is not answered, and that is noticed */
    (void)send(link->socket, request, sizeof *request, MSG_NOSIGNAL | MSG_DONTWAIT);
}

int vs_guard_link_receive(struct vs_guard_link *link, struct vs_guard_reply *reply)
{
    ssize_t len;

    if (link->pid == 0)
        return -1;
    len = recv(link->socket, reply, VS_GUARD_REPLY_SIZE, MSG_DONTWAIT);
    if (len < 0 && (errno == EAGAIN || errno == EINTR))
        return 0;
    if (len != (ssize_t)VS_GUARD_REPLY_SIZE || reply->number != link->number)
        return -1;
    link->waiting = 0;
    link->heard_ns = vs_posix_recent_ns();
    link->base_errors = link->errors_before + reply->base_errors;
    link->base->resets = reply->base_resets; /* the next guard counts on */
    return 1;
}

uint64_t vs_guard_link_deadline_ns(const struct vs_guard_link *link)
{
    return link->waiting ? link->heard_ns + VS_GUARD_SILENCE_NS : UINT64_MAX;
}

void vs_guard_link_excuse(struct vs_guard_link *link, uint64_t late_ns)
{
    link->heard_ns += late_ns;
}

void vs_guard_link_kill(struct vs_guard_link *link)
{
    pid_t pid = (pid_t)link->pid;
    pid_t ended;
    int how = 0;
    int i;

    if (link->dying != 0 && waitpid((pid_t)link->dying, NULL, WNOHANG) != 0)
        link->dying = 0;
    if (pid == 0)
        return;
    link->pid = 0;
    close(link->socket);
    link->socket = -1;
    link->waiting = 0;
    link->errors_before = link->base_errors;
    ended = waitpid(pid, &how, WNOHANG);
    if (ended == 0)
        kill(pid, SIGKILL);
    for (i = 0; i < END_TRIES && ended == 0; i++) {
        poll(NULL, 0, 1);
        ended = waitpid(pid, &how, WNOHANG);
    }
    if (ended == 0)
        link->dying = pid;
    link->status = ended == pid && WIFEXITED(how) ? WEXITSTATUS(how) : -1;
}

int vs_guard_link_stop_base(struct vs_guard_link *link)
{
    uint64_t until_ns = vs_posix_now_ns() + STOP_NS;
    int err = VS_ERR_BUSY;

    vs_posix_take_over();
    while (err == VS_ERR_BUSY && vs_posix_now_ns() < until_ns)
        err = vs_base_recover(link->base);
    return err;
}
