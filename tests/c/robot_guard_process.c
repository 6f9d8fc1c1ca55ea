/* SPDX-License-Identifier: MIT */
/*
 * A guard with real-time priority must let all others run: however fast a base fails, and
 * whatever the worker does, it sleeps between two tries. Each case is a process of its own.
 */
#define _DEFAULT_SOURCE /* MAP_ANONYMOUS */
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base_config.h"
#include "check.h"
#include "guard_process.h"
#include "../../c_src/vs_posix.h"

#define LIFE_MS 300
#define SPARE 20 /* tries that need no sleep: the first ones of each state */

enum end { HANGS_UP, IS_TOLD, ENDS };

static int result;
static volatile uint32_t *tries;

static int fail(struct vs_base *base)
{
    (void)base;
    ++*tries;
    return result;
}

static int fail_exchange(struct vs_base *base, const struct vs_base_command *command,
                         struct vs_base_reading *reading)
{
    (void)command;
    (void)reading;
    return fail(base);
}

/* The guard of a base that does nothing but fail. */
static void live(int socket, int signals_fd, int found)
{
    static const struct vs_base_body body = {1000, 1};
    static const struct vs_base_ops ops = {.name = "failing", .recover = fail,
                                           .exchange = fail_exchange, .close = fail};
    static struct vs_base base;
    struct vs_guard_rest rest;

    base.ops = &ops;
    base.body = &body;
    _exit(vs_guard_process(socket, signals_fd, &base, found, 0, &rest));
}

static void test_sleeps(int how, int found, enum end end)
{
    struct vs_guard_request sense = {.kind = VS_GUARD_SENSE, .number = 1};
    uint64_t began_ns = vs_posix_now_ns();
    int sockets[2];
    int signals[2];
    int status;
    pid_t pid;

    result = how;
    *tries = 0;
    CHECK(socketpair(AF_UNIX, SOCK_SEQPACKET, 0, sockets) == 0 && pipe(signals) == 0);
    pid = fork();
    CHECK(pid >= 0);
    if (pid == 0) {
        close(sockets[0]);
        live(sockets[1], signals[0], found);
    }
    close(sockets[1]);
    CHECK(send(sockets[0], &sense, sizeof sense, 0) == (ssize_t)sizeof sense);
    poll(NULL, 0, LIFE_MS);
    if (end == IS_TOLD)
        CHECK(write(signals[1], "", 1) == 1);
    if (end == HANGS_UP)
        close(sockets[0]);
    sense.kind = VS_GUARD_CLOSE;
    if (end == ENDS)
        CHECK(send(sockets[0], &sense, sizeof sense, 0) == (ssize_t)sizeof sense);
    CHECK(waitpid(pid, &status, 0) == pid && WIFEXITED(status));
    CHECK(WEXITSTATUS(status) == VS_GUARD_UNSURE);
    CHECK(*tries > 10 && *tries <= SPARE + (vs_posix_now_ns() - began_ns) / 1000000u);
    if (end != HANGS_UP)
        close(sockets[0]);
    close(signals[0]);
    close(signals[1]);
}

static uint64_t bus_now_ns(void *context)
{
    (void)context;
    return vs_posix_now_ns();
}

/* The guard of a base that does not answer, and is to be reset 50 ms before the guard gives up. */
static void live_with_reset(int socket, int signals_fd, const char *folder)
{
    static const struct vs_base_ops ops = {.name = "silent", .recover = fail,
                                           .exchange = fail_exchange, .close = fail};
    static struct vs_base base;
    struct vs_guard_rest rest;

    base.ops = &ops;
    base.bus.now_ns = bus_now_ns;
    CHECK(vs_reset_open(&base.reset, folder) == VS_OK);
    base.reset.begun_ns = vs_posix_now_ns() + VS_GUARD_END_NS - 50000000u - VS_RESET_REST_NS;
    _exit(vs_guard_process(socket, signals_fd, &base, 0, 0, &rest));
}

/* Whoever starts next finds a microcontroller that is not held in reset. */
static void test_lets_go_of_a_reset_at_the_end(void)
{
    char folder[] = "/tmp/vsense-reset.XXXXXX";
    char direction[64];
    char value[64];
    char level = 0;
    int was_low = 0;
    int sockets[2];
    int signals[2];
    int fd;
    pid_t pid;

    result = VS_ERR_SILENT;
    CHECK(mkdtemp(folder) != NULL);
    snprintf(direction, sizeof direction, "%s/direction", folder);
    snprintf(value, sizeof value, "%s/value", folder);
    close(open(direction, O_CREAT | O_WRONLY, 0600));
    fd = open(value, O_CREAT | O_RDWR, 0600);
    CHECK(fd >= 0);
    CHECK(socketpair(AF_UNIX, SOCK_SEQPACKET, 0, sockets) == 0 && pipe(signals) == 0);
    pid = fork();
    CHECK(pid >= 0);
    if (pid == 0) {
        close(sockets[0]);
        live_with_reset(sockets[1], signals[0], folder);
    }
    close(sockets[0]);
    close(sockets[1]);
    while (waitpid(pid, NULL, WNOHANG) == 0) {
        was_low |= pread(fd, &level, 1, 0) == 1 && level == '0';
        poll(NULL, 0, 2);
    }
    CHECK(was_low && pread(fd, &level, 1, 0) == 1 && level == '1');
    close(fd);
    close(signals[0]);
    close(signals[1]);
    CHECK(unlink(direction) == 0 && unlink(value) == 0 && rmdir(folder) == 0);
}

int main(void)
{
    static const int results[] = {VS_ERR_BUSY, VS_ERR_LATE, VS_ERR_GARBLED, VS_ERR_SILENT,
                                  VS_ERR_IO};
    size_t i;

    tries = mmap(NULL, sizeof *tries, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    CHECK(tries != MAP_FAILED);
    for (i = 0; i < sizeof results / sizeof results[0]; i++)
        test_sleeps(results[i], (int)i % 2, (enum end)(i % 3));
    test_sleeps(VS_ERR_IO, 0, HANGS_UP);
    test_sleeps(VS_ERR_GARBLED, 1, HANGS_UP);
    test_lets_go_of_a_reset_at_the_end();
    return 0;
}
