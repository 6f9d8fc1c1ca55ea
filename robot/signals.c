/* SPDX-License-Identifier: MIT */
#include "signals.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stddef.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "../c_src/vs_posix.h"

/* A signal handler gets no argument: this is the one way to tell it where to write. */
static volatile sig_atomic_t tell_fd = -1;
static int told_fd = -1;
static volatile sig_atomic_t told;

static const int endings[] = {SIGTERM, SIGINT, SIGHUP, SIGQUIT};

#define ENDINGS (sizeof endings / sizeof endings[0])

static void tell(int number)
{
    int why = errno;
    ssize_t ignored = write((int)tell_fd, "", 1);

    (void)number;
    (void)ignored;
    told = 1;
    errno = why;
}

static void handle(int number, void (*handler)(int))
{
    struct sigaction action;

    sigemptyset(&action.sa_mask);
    action.sa_flags = SA_RESTART;
    action.sa_handler = handler;
    sigaction(number, &action, NULL);
}

static void handle_endings(void (*handler)(int))
{
    size_t i;

    for (i = 0; i < ENDINGS; i++)
        handle(endings[i], handler);
}

int vs_signals_open(int *fd)
{
    int ends[2];

    if (pipe(ends) != 0)
        return -1;
    fcntl(ends[0], F_SETFL, O_NONBLOCK);
    fcntl(ends[1], F_SETFL, O_NONBLOCK);
    vs_posix_keep_from_children(ends[0]);
    vs_posix_keep_from_children(ends[1]);
    if (told_fd >= 0) {
        close(told_fd);
        close((int)tell_fd);
    }
    told_fd = ends[0];
    tell_fd = ends[1];
    told = 0;
    handle_endings(tell);
    handle(SIGPIPE, SIG_IGN);
    handle(SIGCHLD, SIG_DFL);
    *fd = told_fd;
    return 0;
}

int vs_signals_told(void)
{
    return told != 0;
}

void vs_signals_stay_awake(void)
{
    handle(SIGTSTP, SIG_IGN);
}

void vs_signals_ignore(void)
{
    handle_endings(SIG_IGN);
    handle(SIGTSTP, SIG_IGN);
}

void vs_signals_may_sleep(void)
{
    handle(SIGTSTP, SIG_DFL);
}

static void mask(int how)
{
    sigset_t set;
    size_t i;

    sigemptyset(&set);
    for (i = 0; i < ENDINGS; i++)
        sigaddset(&set, endings[i]);
    sigprocmask(how, &set, NULL);
}

long vs_signals_fork(int *socket)
{
    int ends[2];
    pid_t pid;

    if (socketpair(AF_UNIX, SOCK_SEQPACKET, 0, ends) != 0)
        return -1;
    vs_posix_keep_from_children(ends[0]);
    vs_posix_keep_from_children(ends[1]);
    mask(SIG_BLOCK);
    pid = fork();
    *socket = ends[pid == 0];
    close(ends[pid != 0]);
    if (pid != 0)
        vs_signals_unblock();
    if (pid < 0)
        close(*socket);
    return pid;
}

void vs_signals_unblock(void)
{
    mask(SIG_UNBLOCK);
}

int vs_controller_fork(void)
{
    pid_t parent = getpid();
    pid_t pid;

    /* From its first moment on a signal to the child is no word to the daemon. */
    mask(SIG_BLOCK);
    pid = fork();
    if (pid == 0) {
        vs_posix_close_kept();
        handle_endings(SIG_DFL);
        prctl(PR_SET_PDEATHSIG, (unsigned long)SIGKILL);
        if (getppid() != parent)
            _exit(0);
    }
    vs_signals_unblock();
    return (int)pid;
}
