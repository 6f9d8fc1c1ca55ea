/* SPDX-License-Identifier: MIT */
/* robot_world.h - the daemon's base_argos and the firmware's own code at the two ends of an
 * in-memory line on virtual time. The line can lose a byte, the far end can sleep. */
#ifndef ROBOT_WORLD_H
#define ROBOT_WORLD_H

#include <string.h>

#include "base_config.h"
#include "epuck_argos.h"
#include "fw_argos.h"
#include "robot_check.h"

#define MS 1000000u

extern const struct vs_base_ops vs_base_argos;

struct world {
    struct fw_argos fw;
    struct vs_base base;
    uint64_t now_ns;
    uint64_t stalled_until_ns; /* the far end sleeps: bytes wait before the line */
    uint32_t stall_one_in;     /* reads; 0 = never */
    uint32_t random;
    uint8_t waiting[256];
    size_t waiting_len;
    int16_t first_left;        /* of the first frame applied since watch() */
    int16_t first_right;
    int16_t allowed[2];        /* speeds that may be applied, besides 0 and the first */
    int watching;
    uint32_t watched;          /* frames applied since watch() */
    uint64_t reset_ns;         /* when the newest 'R' frame was applied */
    int leds_lost;             /* an 'R' frame with LEDs: only a reset cures that */
    uint32_t lose_written;     /* the byte to the far end that gets lost, 1 = the next; 0: none */
    uint32_t lose_read;        /* the same for bytes from there */
};

/* Removes the byte that is to be lost, if it is among these. Returns how many are left. */
static inline size_t lose(uint32_t *number, uint8_t *buf, size_t len)
{
    uint32_t at = *number;

    if (at == 0)
        return len;
    *number = at > len ? at - (uint32_t)len : 0;
    if (at > len)
        return len;
    memmove(buf + at - 1, buf + at, len - at);
    return len - 1;
}

/* From now on all speeds are the host's, but those that the first frame brings. */
static inline void watch(struct world *w)
{
    w->watching = 1;
    w->watched = 0;
    w->first_left = w->first_right = 0;
    w->allowed[0] = w->allowed[1] = 0;
}

static inline void on_frame(struct world *w)
{
    const struct epuck_argos_actuators *frame = &w->fw.old;

    w->watched++;
    if (w->watched == 1) {
        w->first_left = w->fw.body.outputs.left_steps_s;
        w->first_right = w->fw.body.outputs.right_steps_s;
    } else if (w->watching) {
        CHECK(frame->left_steps_s == 0 || frame->left_steps_s == w->allowed[0]);
        CHECK(frame->right_steps_s == 0 || frame->right_steps_s == w->allowed[1]);
    }
    if (frame->reset == EPUCK_ARGOS_RESET)
        w->reset_ns = w->now_ns;
    if (frame->reset == EPUCK_ARGOS_RESET && frame->leds != 0)
        w->leds_lost = 1;
}

static inline void live(struct world *w)
{
    if (w->now_ns < w->stalled_until_ns)
        return;
    fw_argos_receive(&w->fw, w->waiting, w->waiting_len, w->now_ns / 1000);
    w->waiting_len = 0;
    while (fw_argos_advance(&w->fw, w->now_ns / 1000))
        on_frame(w);
}

static inline uint64_t io_now(void *context)
{
    return ((struct world *)context)->now_ns;
}

static inline int io_read(void *context, uint8_t *buf, size_t cap, uint64_t deadline_ns)
{
    struct world *w = context;

    if (w->stall_one_in != 0 && w->now_ns >= w->stalled_until_ns &&
        draw(&w->random, w->stall_one_in) == 0)
        w->stalled_until_ns = w->now_ns + draw(&w->random, 80) * MS;
    for (;;) {
        size_t len = 0;

        live(w);
        if (w->now_ns >= w->stalled_until_ns)
            len = fw_argos_transmit(&w->fw, buf, cap, w->now_ns / 1000);
        len = lose(&w->lose_read, buf, len);
        if (len > 0)
            return (int)len;
        if (w->now_ns >= deadline_ns)
            return 0;
        w->now_ns += 100000 + draw(&w->random, 300000);
        if (w->now_ns > deadline_ns)
            w->now_ns = deadline_ns;
    }
}

static inline int io_write(void *context, const uint8_t *buf, size_t len, uint64_t deadline_ns)
{
    struct world *w = context;

    (void)deadline_ns;
    CHECK(w->waiting_len + len <= sizeof w->waiting);
    memcpy(w->waiting + w->waiting_len, buf, len);
    w->waiting_len += lose(&w->lose_written, w->waiting + w->waiting_len, len);
    live(w);
    return VS_OK;
}

static inline void begin(struct world *w, uint32_t seed)
{
    struct vs_base_config config = {&vs_base_argos, "/nowhere", {"", ""}, 2, 115, 0.0867438559f, {0, 0}, ""};

    memset(w, 0, sizeof *w);
    w->random = seed * 2654435761u + 1u;
    w->now_ns = 1000 * MS;
    w->base.ops = &vs_base_argos;
    CHECK(vs_base_argos.open(&w->base, &config) == VS_ERR_IO);
    w->base.io.context = w;
    w->base.io.now_ns = io_now;
    w->base.io.read = io_read;
    w->base.io.write = io_write;
    fw_argos_init(&w->fw);
}

static inline void feed(struct world *w, const uint8_t *buf, size_t len)
{
    io_write(w, buf, len, 0);
}

static inline void pass(struct world *w, uint64_t ns)
{
    w->now_ns += ns;
    live(w);
}

#endif
