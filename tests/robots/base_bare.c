/* SPDX-License-Identifier: MIT */
/*
 * base_bare.c - a robot that is no e-puck: two wheels and one lamp behind a serial line,
 * nothing else. "left right lamp\n" sets them, "ok\n" is the answer.
 */
#include "base_config.h"

#include <stdio.h>
#include <string.h>

#include "../../c_src/vs_posix.h"


static const struct vs_base_body body = {400, 1000000};

struct bare {
    uint8_t found;
};

enum { STATE_FITS = 1 / (sizeof(struct bare) <= VS_BASE_STATE_MAX) };

static struct bare *of(struct vs_base *base)
{
    return (struct bare *)(void *)base->state.bytes;
}

static int open_bare(struct vs_base *base, const struct vs_base_config *config)
{
    base->body = &body;
    vs_posix_io(&base->io, &base->fd);
    return vs_posix_open_serial(config->device, 115200, VS_BASE_LOCK_NS, &base->fd);
}

/* Reads to the end of "ok\n", for at the longest limit_ns. */
static int await_answer(struct vs_base *base, uint64_t limit_ns)
{
    uint64_t deadline_ns = base->io.now_ns(base->io.context) + limit_ns;
    uint8_t last = 0;
    int len;

    while (last != '\n') {
        len = base->io.read(base->io.context, &last, 1, deadline_ns);
        if (len <= 0)
            return len < 0 ? len : VS_ERR_SILENT;
    }
    return VS_OK;
}

static int say(struct vs_base *base, const struct vs_base_command *command)
{
    uint64_t deadline_ns = base->io.now_ns(base->io.context) + VS_BASE_EXCHANGE_NS;
    char line[32];
    int err;

    snprintf(line, sizeof line, "%d %d %d\n", command->left_steps_s, command->right_steps_s,
             command->leds != 0);
    err = base->io.write(base->io.context, (const uint8_t *)line, strlen(line), deadline_ns);
    return err == VS_OK ? await_answer(base, VS_BASE_EXCHANGE_NS) : err;
}

static int recover_bare(struct vs_base *base)
{
    static const struct vs_base_command off;
    uint8_t scrap[64];
    int err = base->io.read(base->io.context, scrap, sizeof scrap, 0);

    if (err >= 0)
        err = say(base, &off);
    of(base)->found = err == VS_OK;
    return err;
}

static int exchange_bare(struct vs_base *base, const struct vs_base_command *command,
                         struct vs_base_reading *reading)
{
    int err = of(base)->found ? say(base, command) : VS_ERR_SILENT;

    reading->blind = 1;
    of(base)->found = err == VS_OK;
    return err;
}

static int close_bare(struct vs_base *base)
{
    static const struct vs_base_command off;

    return say(base, &off);
}

static const struct vs_base_choice choices[] = {{NULL, NULL}};

const struct vs_base_ops vs_base_bare = {
    "bare", "bare:DEVICE  two wheels and a lamp", "/dev/ttyUSB0", 0, choices,
    open_bare, recover_bare, exchange_bare, close_bare,
};
