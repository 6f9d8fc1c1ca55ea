/* SPDX-License-Identifier: MIT */
/*
 * searching.c - a controller that looks for keys in all memory of its process and in all files that
 * are open there, and writes what it has found into a file. What it looks for are its parameters,
 * each byte XOR MASK, so that they are no finds themselves.
 */
#define _GNU_SOURCE
#include "controller.h"

#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define MASK 0x5A
#define NEEDLE_MAX 64
#define CHUNK 8192

struct needle {
    const char *name;
    unsigned char masked[NEEDLE_MAX];
    size_t len;
    unsigned found;
};

static const char *const names[] = {"swarm", "text", "first", "second", "canary"};

#define NEEDLES (sizeof names / sizeof *names)

struct searching {
    unsigned char canary[NEEDLE_MAX]; /* not masked: this one is to be found */
    int done;
};

static void look(struct needle *needles, unsigned char *data, size_t len)
{
    size_t i, n;

    for (i = 0; i < len; i++)
        data[i] ^= MASK;
    for (n = 0; n < NEEDLES; n++)
        if (memmem(data, len, needles[n].masked, needles[n].len) != NULL)
            needles[n].found++;
}

/* From an offset on, to its end or to what cannot be read. */
static void search(struct needle *needles, int fd, unsigned long long from, unsigned long long to)
{
    unsigned char data[CHUNK + NEEDLE_MAX];
    ssize_t got;

    for (; from < to; from += CHUNK) {
        unsigned long long left = to - from;

        got = pread(fd, data, left < sizeof data ? (size_t)left : sizeof data, (off_t)from);
        if (got <= 0)
            return;
        look(needles, data, (size_t)got);
    }
}

static void search_memory(struct needle *needles)
{
    FILE *maps = fopen("/proc/self/maps", "r");
    int memory = open("/proc/self/mem", O_RDONLY);
    unsigned long long from, to;
    char line[512], rights[8];

    while (maps != NULL && fgets(line, sizeof line, maps) != NULL)
        if (sscanf(line, "%llx-%llx %7s", &from, &to, rights) == 3 && rights[0] == 'r' &&
            strstr(line, "[v") == NULL)
            search(needles, memory, from, to);
    if (maps != NULL)
        fclose(maps);
    close(memory);
}

static void search_descriptors(struct needle *needles)
{
    struct stat status;
    int fd;

    for (fd = 0; fd < 1024; fd++)
        if (fstat(fd, &status) == 0 && S_ISREG(status.st_mode))
            search(needles, fd, 0, (unsigned long long)status.st_size);
}

static size_t read_hex(const char *text, unsigned char *bytes)
{
    unsigned value;
    size_t len = 0;

    while (len < NEEDLE_MAX && sscanf(text + 2 * len, "%2x", &value) == 1)
        bytes[len++] = (unsigned char)value;
    return len;
}

static void init(void *state, struct vs_robot *robot)
{
    (void)state;
    vs_robot_set_wheels(robot, 0, 0);
}

static void step(void *state, struct vs_robot *robot)
{
    struct searching *s = state;
    struct needle needles[NEEDLES];
    char text[2 * NEEDLE_MAX + 1], path[256];
    FILE *report;
    size_t i, n;

    if (s->done++ != 5) /* its session is open, and others are, too */
        return;
    memset(needles, 0, sizeof needles);
    for (n = 0; n < NEEDLES; n++) {
        needles[n].name = names[n];
        if (vs_robot_param_text(robot, names[n], text, sizeof text) > 0)
            needles[n].len = read_hex(text, needles[n].masked);
    }
    for (i = 0; i < needles[NEEDLES - 1].len; i++)
        s->canary[i] = needles[NEEDLES - 1].masked[i] ^ MASK;
    search_memory(needles);
    search_descriptors(needles);
    if (vs_robot_param_text(robot, "report", path, sizeof path) > 0 &&
        (report = fopen(path, "a")) != NULL) {
        fprintf(report, "controller %d", (int)getpid());
        for (n = 0; n < NEEDLES; n++)
            fprintf(report, " %s %u", needles[n].name, needles[n].len ? needles[n].found : 9999);
        fprintf(report, "\n");
        fclose(report);
    }
}

const struct vs_controller vs_controller = {"searching", sizeof(struct searching), init, step, NULL};
