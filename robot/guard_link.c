/* SPDX-License-Identifier: MIT */
#include "guard_link.h"

#include <errno.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "signals.h"
#include "../c_src/vs_posix.h"

#define STOP_NS 500000000u /* [ns] two whole recoveries */

static void become_guard(struct vs_guard_link *link, int socket, int found)
{
    int signals_fd;
    size_t i;

    for (i = 0; i < link->foreign_count; i++)
        if (link->foreign_fds[i] >= 0)
            close(link->foreign_fds[i]);
    if (vs_signals_open(&signals_fd) != 0)
        _exit(VS_GUARD_UNSURE);
    vs_signals_stay_awake();
    vs_signals_unblock();
    _exit(vs_guard_process(socket, signals_fd, link->base, found));
}

int vs_guard_link_start(struct vs_guard_link *link, int found)
{
    int ends[2];
    pid_t pid;

    if (socketpair(AF_UNIX, SOCK_SEQPACKET, 0, ends) != 0)
        return -1;
    vs_posix_keep_from_children(ends[0]);
    vs_posix_keep_from_children(ends[1]);
    vs_signals_block();
    pid = fork();
    if (pid == 0) {
        close(ends[0]);
        become_guard(link, ends[1], found);
    }
    vs_signals_unblock();
    close(ends[1]);
    if (pid < 0) {
        close(ends[0]);
        return -1;
    }
    link->pid = pid;
    link->socket = ends[0];
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
    link->pinged = request->kind == VS_GUARD_PING;
    /* a request that cannot be sent is not answered, and that is noticed */
    (void)send(link->socket, request, sizeof *request, MSG_NOSIGNAL | MSG_DONTWAIT);
}

int vs_guard_link_receive(struct vs_guard_link *link, struct vs_guard_reply *reply)
{
    ssize_t len;

    if (link->pid == 0)
        return -1;
    len = recv(link->socket, reply, sizeof *reply, MSG_DONTWAIT);
    if (len < 0 && (errno == EAGAIN || errno == EINTR))
        return 0;
    if (len != (ssize_t)sizeof *reply || reply->number != link->number)
        return -1;
    link->waiting = 0;
    link->pinged = 0;
    link->heard_ns = vs_posix_recent_ns();
    link->base_errors = link->errors_before + reply->base_errors;
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

    if (pid == 0)
        return;
    link->pid = 0;
    close(link->socket);
    link->socket = -1;
    link->waiting = 0;
    link->pinged = 0;
    link->errors_before = link->base_errors;
    ended = waitpid(pid, &how, WNOHANG);
    if (ended == 0) {
        kill(pid, SIGKILL);
        ended = waitpid(pid, &how, 0);
    }
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
