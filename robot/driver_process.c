/* SPDX-License-Identifier: MIT */
#include "driver_process.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "guard_rights.h"
#include "report.h"
#include "signals.h"
#include "../c_src/vs_format.h"
#include "../c_src/vs_posix.h"

uint64_t vs_driver_clock_ns(void)
{
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

int vs_driver_open(struct vs_driver_line *line, const char *command)
{
    int zero = open("/dev/zero", O_RDWR); /* POSIX has no other name for memory to share */
    void *shared = MAP_FAILED;
    int ends[2];

    if (zero >= 0) {
        shared = mmap(NULL, sizeof *line->driver, PROT_READ | PROT_WRITE, MAP_SHARED, zero, 0);
        close(zero);
    }
    if (shared == MAP_FAILED || socketpair(AF_UNIX, SOCK_STREAM, 0, ends) != 0)
        return VS_ERR_IO;
    vs_posix_keep_from_children(ends[0]);
    vs_posix_keep_from_children(ends[1]);
    fcntl(ends[0], F_SETFL, O_NONBLOCK);
    line->command = command;
    line->driver = shared;
    line->own = ends[0];
    line->theirs = ends[1];
    return VS_OK;
}

static void ended(struct vs_driver *driver, int how)
{
    driver->pid = 0;
    driver->how = how;
    driver->killed_ns = 0;
}

/* Nobody else is told of its end than who started it: another one looks whether it is there. */
int vs_driver_runs(struct vs_driver_line *line, uint64_t now_ns)
{
    struct vs_driver *driver = line->driver;
    int how = 0;
    pid_t pid;

    if (driver->pid == 0)
        return 0;
    pid = waitpid((pid_t)driver->pid, &how, WNOHANG);
    if (pid > 0)
        ended(driver, how);
    else if (pid < 0 && kill((pid_t)driver->pid, 0) != 0)
        ended(driver, -1);
    else if (driver->killed_ns != 0 && now_ns >= driver->killed_ns + VS_DRIVER_KILL_NS)
        ended(driver, -1);
    return driver->pid != 0;
}

/* In the child. Its end of the line is its standard input and output; it is in a session of its
 * own, so that Ctrl-C is its daemon's to hear, which has it stop the wheels. */
static void become(const struct vs_driver_line *line)
{
    char command[sizeof "exec " + VS_BASE_DEVICE_MAX];

    line->driver->pid = (int32_t)getpid(); /* whoever started it may be gone by now */
    vs_format(command, sizeof command, "exec %s", line->command);
    vs_rights_give_back();
    vs_signals_may_sleep();
    setsid();
    dup2(line->theirs, STDIN_FILENO);
    dup2(line->theirs, STDOUT_FILENO);
    vs_posix_close_but(-1, -1);
    execl("/bin/sh", "sh", "-c", command, (char *)NULL);
    vs_report("driver: cannot start /bin/sh: %s", vs_trouble(errno));
    _exit(127);
}

static void empty(int fd)
{
    uint8_t scrap[4 * VS_DRIVER_REPORT_LEN];

    while (recv(fd, scrap, sizeof scrap, MSG_DONTWAIT) > 0)
        ;
}

int vs_driver_start(struct vs_driver_line *line, uint64_t now_ns)
{
    struct vs_driver *driver = line->driver;
    pid_t pid;

    empty(line->own);
    empty(line->theirs);
    driver->started_ns = now_ns;
    driver->sent_ns = driver->order_ns = driver->rest_ns = 0;
    driver->counting = 0;
    driver->got = 0;
    pid = fork();
    if (pid == 0)
        become(line);
    if (pid < 0)
        return VS_ERR_IO;
    driver->pid = (int32_t)pid;
    return VS_OK;
}

void vs_driver_kill(struct vs_driver_line *line, uint64_t now_ns)
{
    struct vs_driver *driver = line->driver;

    if (driver->pid == 0 || driver->killed_ns != 0)
        return;
    kill((pid_t)-driver->pid, SIGKILL);
    kill((pid_t)driver->pid, SIGKILL); /* that has no session of its own yet */
    driver->killed_ns = now_ns;
}
