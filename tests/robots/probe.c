/* SPDX-License-Identifier: MIT */
/*
 * A controller that shows on its LEDs how many steps it has lived, and system calls that go
 * wrong when the environment says so. Link with --wrap=fork,--wrap=recv,--wrap=waitpid,
 * --wrap=write,--wrap=clock_gettime.
 */
#include "controller.h"

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define DATAGRAM_CAP 1201
#define GAP_MS 30

struct probe {
    int steps;
    int drops;
    int talk;
};

/* A child that becomes no other program, and has a file of its own; what its parent says of it. */
static void help(void)
{
    FILE *file = fopen("/dev/null", "r");
    pid_t pid = fork();

    while (pid == 0 && file != NULL && fgetc(file) == EOF)
        (void)poll(NULL, 0, GAP_MS);
    fprintf(stderr, "helper %ld\n", (long)pid);
}

static void init(void *state, struct vs_robot *robot)
{
    struct probe *probe = state;

    probe->drops = vs_robot_actuator(robot, "drops");
    probe->talk = vs_robot_param(robot, "talk", 0) > 0;
    if (vs_robot_param(robot, "child", 0) > 0 && system("sleep 5 >/dev/null 2>&1 &") != 0)
        abort();
    if (vs_robot_param(robot, "helper", 0) > 0)
        help();
}

/* Shows its steps, and logs a line in the first three. */
static void talk(const struct probe *probe, struct vs_robot *robot)
{
    char line[32];

    vs_robot_show(robot, "steps", probe->steps);
    vs_robot_show_text(robot, "state", probe->steps % 2 ? "odd" : "even");
    snprintf(line, sizeof line, "step %d", probe->steps);
    if (probe->steps <= 3)
        vs_robot_log(robot, line);
}

static void step(void *state, struct vs_robot *robot)
{
    struct probe *probe = state;

    probe->steps++;
    vs_robot_set_leds(robot, (unsigned int)probe->steps);
    vs_robot_set_wheels(robot, 300, 300);
    if (probe->steps == 1)
        vs_robot_actuate(robot, probe->drops, 0, 5);
    if (probe->talk)
        talk(probe, robot);
}

const struct vs_controller vs_controller = {"probe", sizeof(struct probe), init, step, NULL};

pid_t __real_fork(void);
pid_t __wrap_fork(void);
ssize_t __real_recv(int fd, void *buf, size_t len, int flags);
ssize_t __wrap_recv(int fd, void *buf, size_t len, int flags);
int __real_clock_gettime(clockid_t id, struct timespec *now);
int __wrap_clock_gettime(clockid_t id, struct timespec *now);

/* PROBE_FORKS: after so many it fails. */
pid_t __wrap_fork(void)
{
    static int forks;
    const char *most = getenv("PROBE_FORKS");

    if (most != NULL && forks++ >= atoi(most)) {
        errno = EAGAIN;
        return -1;
    }
    return __real_fork();
}

/* PROBE_GAP: the process is held up before recv, and in that gap a datagram comes. */
ssize_t __wrap_recv(int fd, void *buf, size_t len, int flags)
{
    struct pollfd line = {fd, POLLIN, 0};

    if (len == DATAGRAM_CAP && getenv("PROBE_GAP") != NULL)
        (void)poll(&line, 1, GAP_MS);
    return __real_recv(fd, buf, len, flags);
}

pid_t __wrap_waitpid(pid_t pid, int *how, int options);
pid_t __real_waitpid(pid_t pid, int *how, int options);
ssize_t __wrap_write(int fd, const void *buf, size_t len);
ssize_t __real_write(int fd, const void *buf, size_t len);

/* PROBE_UNDEAD: no child ever ends, as if a driver held it. */
pid_t __wrap_waitpid(pid_t pid, int *how, int options)
{
    if (getenv("PROBE_UNDEAD") == NULL)
        return __real_waitpid(pid, how, options);
    while (!(options & WNOHANG))
        (void)poll(NULL, 0, -1);
    return 0;
}

/* PROBE_LOG names a file: while it is there the log takes nothing, and whoever writes waits. */
ssize_t __wrap_write(int fd, const void *buf, size_t len)
{
    const char *block = getenv("PROBE_LOG");

    while (fd == STDERR_FILENO && block != NULL && access(block, F_OK) == 0)
        (void)poll(NULL, 0, 1);
    return __real_write(fd, buf, len);
}

/* PROBE_SLEW: NTP lets CLOCK_MONOTONIC run so many ppm wrong, since the machine's start.
 * PROBE_NO_RAW: and the kernel has no other clock. */
int __wrap_clock_gettime(clockid_t id, struct timespec *now)
{
    const char *ppm = getenv("PROBE_SLEW");
    int64_t ns;

    if (id == CLOCK_MONOTONIC_RAW && getenv("PROBE_NO_RAW") != NULL) {
        errno = EINVAL;
        return -1;
    }
    if (id != CLOCK_MONOTONIC || ppm == NULL)
        return __real_clock_gettime(id, now);
    __real_clock_gettime(CLOCK_MONOTONIC_RAW, now);
    ns = (int64_t)now->tv_sec * 1000000000 + now->tv_nsec;
    ns += ns / 1000 * atoi(ppm) / 1000;
    now->tv_sec = (time_t)(ns / 1000000000);
    now->tv_nsec = (long)(ns % 1000000000);
    return 0;
}
