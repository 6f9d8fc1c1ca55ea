/* SPDX-License-Identifier: MIT */
/*
 * init.c - process 1 of the emulated board: mounts, loads modules, brings the network
 * up, waits for the devices, starts vsensed, and does what the console tells it:
 *
 *     memory   prints the resident memory of every vsensed
 *     term     SIGTERM to vsensed        kill   SIGKILL to its worker
 *
 * /boot/plan says what: lines "module PATH", "wait PATH" and "run WORD WORD ..."; "old"
 * before that: vsensed finds a kernel that knows no call younger than Linux 2.6.24. Every
 * line that it prints begins with "board: ". When vsensed has ended it switches off.
 */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <net/if.h>
#include <poll.h>
#include <signal.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/reboot.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define WORDS_MAX 32
#define DEVICE_MS 20000

/* Numbers of system calls only grow. Source: arch/arm/include/asm/unistd.h of Linux: utimensat,
 * 348, is of 2.6.22; the next ones came until 2.6.25. Those of ARM itself are above all others. */
#define OLD_CALLS 348
#define ARM_CALLS 0x0F0000

static int old;

static void say(const char *what, const char *which)
{
    printf("board: %s %s\n", what, which);
    fflush(stdout);
}

static void off(void)
{
    sync();
    reboot(RB_POWER_OFF);
    pause();
}

static void fail(const char *what)
{
    say(what, strerror(errno));
    off();
}

static void load_module(const char *path)
{
    int fd = open(path, O_RDONLY);

    if (fd < 0 || (syscall(SYS_finit_module, fd, "", 0) != 0 && errno != EEXIST))
        fail(path);
    close(fd);
}

static void wait_for(const char *path)
{
    int waited_ms;

    for (waited_ms = 0; access(path, F_OK) != 0; waited_ms += 10) {
        if (waited_ms > DEVICE_MS)
            fail(path);
        poll(NULL, 0, 10);
    }
    say("has", path);
}

/* 10.0.2.15/24, as QEMU's user network wants it; the host is 10.0.2.2. */
static void bring_up(const char *name)
{
    struct ifreq request;
    struct sockaddr_in *address = (struct sockaddr_in *)&request.ifr_addr;
    int fd = socket(AF_INET, SOCK_DGRAM, 0);

    memset(&request, 0, sizeof request);
    strncpy(request.ifr_name, name, IFNAMSIZ - 1);
    address->sin_family = AF_INET;
    inet_pton(AF_INET, "10.0.2.15", &address->sin_addr);
    if (ioctl(fd, SIOCSIFADDR, &request) != 0)
        fail("address");
    inet_pton(AF_INET, "255.255.255.0", &address->sin_addr);
    if (ioctl(fd, SIOCSIFNETMASK, &request) != 0)
        fail("netmask");
    if (ioctl(fd, SIOCGIFFLAGS, &request) != 0)
        fail("flags");
    request.ifr_flags |= IFF_UP | IFF_RUNNING;
    if (ioctl(fd, SIOCSIFFLAGS, &request) != 0)
        fail("up");
    close(fd);
}

/* 1 if the file's first bytes are text. */
static int begins(const char *pid, const char *name, const char *text)
{
    char path[300];
    char line[64] = "";
    FILE *file;

    snprintf(path, sizeof path, "/proc/%s/%s", pid, name);
    file = fopen(path, "r");
    if (file == NULL)
        return 0;
    if (fgets(line, sizeof line, file) == NULL)
        line[0] = '\0';
    fclose(file);
    return strncmp(line, text, strlen(text)) == 0;
}

/* Prints what one process holds, if it is a vsensed: counted page by page, since the sums
 * in "status" lag behind by up to 64 pages, and a page that two hold as a half. */
static void tell_process(const char *pid)
{
    char path[300];
    char line[200];
    FILE *file;

    if (!begins(pid, "comm", "vsensed"))
        return;
    snprintf(path, sizeof path, "/proc/%s/smaps_rollup", pid);
    file = fopen(path, "r");
    if (file == NULL)
        fail(path);
    while (fgets(line, sizeof line, file) != NULL) {
        line[strcspn(line, "\n")] = '\0';
        if (strncmp(line, "Pss:", 4) == 0)
            say("memory", line + 4);
    }
    fclose(file);
}

static void tell_memory(void)
{
    DIR *all = opendir("/proc");
    struct dirent *one;

    while (all != NULL && (one = readdir(all)) != NULL)
        if (one->d_name[0] >= '0' && one->d_name[0] <= '9')
            tell_process(one->d_name);
    if (all != NULL)
        closedir(all);
    say("memory", "end");
}

/* Every younger system call fails from now on as it does on an old kernel. */
static void become_old(void)
{
    struct sock_filter filter[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
        BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, ARM_CALLS, 2, 0),
        BPF_JUMP(BPF_JMP | BPF_JGT | BPF_K, OLD_CALLS, 0, 1),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | ENOSYS),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
    };
    struct sock_fprog program = {sizeof filter / sizeof filter[0], filter};

    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 ||
        prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) != 0)
        fail("seccomp");
    errno = 0;
    if (syscall(SYS_clock_gettime64, CLOCK_MONOTONIC, NULL) != -1 || errno != ENOSYS)
        fail("the kernel is not old");
    say("kernel", "is old");
}

static pid_t run(char *words)
{
    char *argv[WORDS_MAX + 1];
    int count = 0;
    pid_t pid;

    for (argv[count] = strtok(words, " "); argv[count] != NULL && count < WORDS_MAX;)
        argv[++count] = strtok(NULL, " ");
    pid = fork();
    if (pid == 0) {
        if (old)
            become_old();
        execv(argv[0], argv);
        fail(argv[0]);
    }
    return pid;
}

/* Does what /boot/plan says. Returns the daemon's process id. */
static pid_t follow_plan(void)
{
    char line[1000];
    FILE *plan = fopen("/boot/plan", "r");
    pid_t pid = -1;

    while (plan != NULL && fgets(line, sizeof line, plan) != NULL) {
        line[strcspn(line, "\n")] = '\0';
        if (strncmp(line, "module ", 7) == 0)
            load_module(line + 7);
        else if (strncmp(line, "wait ", 5) == 0)
            wait_for(line + 5);
        else if (strncmp(line, "up ", 3) == 0)
            bring_up(line + 3);
        else if (strcmp(line, "old") == 0)
            old = 1;
        else if (strncmp(line, "run ", 4) == 0)
            pid = run(line + 4);
    }
    return pid;
}

/* Lives until vsensed has ended; gives how it did. */
static int live(pid_t pid)
{
    char line[64];
    struct pollfd console = {STDIN_FILENO, POLLIN, 0};
    int status;

    while (waitpid(pid, &status, WNOHANG) != pid) {
        if (poll(&console, 1, 20) <= 0 || fgets(line, sizeof line, stdin) == NULL)
            continue;
        if (strncmp(line, "memory", 6) == 0)
            tell_memory();
        else if (strncmp(line, "term", 4) == 0)
            kill(pid, SIGTERM);
        else if (strncmp(line, "kill", 4) == 0)
            kill(pid, SIGKILL);
    }
    return status;
}

int main(void)
{
    char text[32];
    int status;

    mkdir("/proc", 0755);
    mkdir("/sys", 0755);
    if (mount("devtmpfs", "/dev", "devtmpfs", 0, "") != 0 ||
        mount("proc", "/proc", "proc", 0, "") != 0 || mount("sysfs", "/sys", "sysfs", 0, "") != 0)
        fail("mount");
    setvbuf(stdin, NULL, _IONBF, 0);
    status = live(follow_plan());
    snprintf(text, sizeof text, WIFEXITED(status) ? "%d" : "signal %d",
             WIFEXITED(status) ? WEXITSTATUS(status) : WTERMSIG(status));
    say("vsensed ended", text);
    off();
    return 0;
}
