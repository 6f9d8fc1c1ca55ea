/* SPDX-License-Identifier: MIT */
#include "restart.h"

#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <unistd.h>

#include "guard_rights.h"
#include "signals.h"

#define END_MS 1000 /* [ms] a killed process may take to end */
#define PATH_MAX_BYTES 255

int vs_restart_by_service(void)
{
    return getenv(VS_SERVICE) != NULL;
}

int vs_restart_end(long pid, int ended)
{
    struct pollfd end = {ended, 0, 0};

    /* no longer its child: it has ended, and the number may be another process's */
    if (getppid() != (pid_t)pid)
        return 1;
    kill((pid_t)pid, SIGKILL);
    return poll(&end, 1, END_MS) > 0;
}

void vs_restart(char *const argv[])
{
    static const char own[] = "/proc/self/exe";
    char path[PATH_MAX_BYTES + 1];
    ssize_t len = readlink(own, path, PATH_MAX_BYTES);

    vs_rights_give_back();
    vs_signals_may_sleep();
    /* by its own name: whoever looks for it finds it */
    if (len > 0) {
        path[len] = '\0';
        execv(path, argv);
    }
    execv(own, argv); /* the file has another name now, or none */
}
