/* SPDX-License-Identifier: MIT */
/*
 * base_argos.c - IRIDIA's fixed-struct UART protocol (epuck_argos.h). The link has
 * no framing: the one thing that tells where the microcontroller stands is that it
 * sends 72 bytes right after the last byte of a frame. It must not be written to
 * while it sends.
 */
#include "base.h"

#include <string.h>

#include "../c_src/epuck_argos.h"
#include "../c_src/vs_posix.h"

#define LOCK_WAIT_NS 2000000000u /* [ns] for an earlier daemon's end */
#define EXCHANGE_NS 30000000u    /* [ns] 7.3 are the line's */
#define OWED_NS 100000000u       /* [ns] an answer that is later than this is none */
#define QUIET_NS 10000000u       /* [ns] longer than the 6.3 ms of a burst */
#define DRAIN_NS 40000000u       /* [ns] longest step of draining */
#define FEED_NS 15000000u        /* [ns] a burst comes within this or not at all */
#define PROMPT_NS 10000000u      /* [ns] an answer later than this proves nothing */
#define LEAVE_NS 3000000u        /* [ns] the line's time for a last frame */

enum {
    FEEDS_MAX = EPUCK_ARGOS_ACTUATOR_LEN,
    PROOFS = 2,
    NO_BURST = 2 * EPUCK_ARGOS_SENSOR_LEN, /* as `got`: what is read proves nothing */
    PHASE_UNKNOWN = 0, /* nobody knows where the microcontroller stands */
    PHASE_READY,       /* it waits for a frame's first byte */
    PHASE_OWED,        /* it got a frame, its burst is not complete */
    PHASE_QUIET,       /* recovery: waiting for silence */
    PHASE_FEED,        /* recovery: byte by byte until a burst comes */
    PHASE_PROVE        /* recovery: a burst came; is it where we think? */
};

static uint64_t now(const struct vs_base *base)
{
    return base->io.now_ns(base->io.context);
}

static int open_argos(struct vs_base *base, const char *device)
{
    int err = vs_posix_open_serial(device, LOCK_WAIT_NS, &base->fd);

    if (err == VS_OK)
        vs_posix_io(&base->io, &base->fd);
    base->phase = PHASE_UNKNOWN;
    return err;
}

/* Reads on until the burst is complete (VS_OK) or time is up (VS_ERR_BUSY). */
static int collect(struct vs_base *base, uint64_t deadline_ns)
{
    while (base->got < EPUCK_ARGOS_SENSOR_LEN) {
        int len = base->io.read(base->io.context, base->frame + base->got,
                                EPUCK_ARGOS_SENSOR_LEN - base->got, deadline_ns);

        if (len < 0)
            return len;
        if (len == 0)
            return VS_ERR_BUSY;
        base->got += (size_t)len;
    }
    return VS_OK;
}

static int write_zeros(struct vs_base *base, size_t len)
{
    static const uint8_t zeros[EPUCK_ARGOS_ACTUATOR_LEN];

    base->got = 0;
    base->written_ns = now(base);
    return base->io.write(base->io.context, zeros, len, base->written_ns + FEED_NS);
}

/* Waits for silence. Exactly the burst that was owed before it tells as much as one
 * that was fed for. */
static int drain(struct vs_base *base)
{
    uint64_t until_ns = now(base) + DRAIN_NS;

    while (now(base) < until_ns) {
        uint8_t scrap[EPUCK_ARGOS_SENSOR_LEN];
        int len = base->io.read(base->io.context, scrap, sizeof scrap,
                                now(base) + QUIET_NS);

        if (len < 0)
            return len;
        if (len == 0) {
            base->phase = base->got == EPUCK_ARGOS_SENSOR_LEN ? PHASE_PROVE : PHASE_FEED;
            return VS_ERR_BUSY;
        }
        base->got += (size_t)len;
    }
    return VS_ERR_BUSY;
}

/* One byte more: completes the frame, or the greeting, that it waits for? */
static int feed(struct vs_base *base)
{
    int err = write_zeros(base, 1);

    if (err == VS_OK)
        err = collect(base, base->written_ns + FEED_NS);
    if (err == VS_OK) {
        base->phase = PHASE_PROVE;
        return VS_ERR_BUSY;
    }
    if (err != VS_ERR_BUSY)
        return err;
    if (base->got > 0) {
        base->phase = PHASE_QUIET;
        return VS_ERR_BUSY;
    }
    base->fed++;
    if (base->fed < FEEDS_MAX)
        return VS_ERR_BUSY;
    base->phase = PHASE_UNKNOWN;
    return VS_ERR_SILENT;
}

/* The zero-speed frame, its last byte held back: a burst before that byte means
 * that fed bytes had piled up behind a slow answer. Silence then proves the frame's
 * place only if the far end was awake, which a prompt answer to the last byte shows. */
static int prove(struct vs_base *base)
{
    struct epuck_argos_sensors sensors;
    int err = write_zeros(base, EPUCK_ARGOS_ACTUATOR_LEN - 1);

    base->fed = 0;
    base->phase = PHASE_QUIET;
    if (err == VS_OK)
        err = collect(base, base->written_ns + FEED_NS);
    if (err != VS_ERR_BUSY || base->got > 0) {
        base->got = NO_BURST;
        base->proofs = 0;
        return err == VS_OK ? VS_ERR_BUSY : err;
    }
    err = write_zeros(base, 1);
    if (err == VS_OK)
        err = collect(base, base->written_ns + EXCHANGE_NS);
    if (err == VS_OK && epuck_argos_get_sensors(base->frame, &sensors) != 0)
        err = VS_ERR_BUSY;
    base->proofs++;
    if (err != VS_OK || now(base) >= base->written_ns + PROMPT_NS)
        base->proofs = 0;
    if (err == VS_OK)
        base->phase = base->proofs < PROOFS ? PHASE_PROVE : PHASE_READY;
    return err == VS_OK && base->proofs < PROOFS ? VS_ERR_BUSY : err;
}

static int recover_argos(struct vs_base *base)
{
    switch (base->phase) {
    case PHASE_FEED:
        return feed(base);
    case PHASE_PROVE:
        return prove(base);
    case PHASE_QUIET:
        return drain(base);
    default:
        if (base->phase != PHASE_OWED)
            base->got = NO_BURST;
        base->fed = 0;
        base->proofs = 0;
        base->phase = PHASE_QUIET;
        return drain(base);
    }
}

/* Makes sure that the microcontroller waits for a frame and nothing is unread. */
static int settle(struct vs_base *base, uint64_t deadline_ns)
{
    uint8_t stray;
    int err;

    if (base->phase == PHASE_OWED) {
        err = collect(base, deadline_ns);
        if (err == VS_ERR_BUSY && now(base) < base->written_ns + OWED_NS)
            return VS_ERR_BUSY;
        if (err != VS_OK)
            return err == VS_ERR_BUSY ? VS_ERR_SILENT : err;
        base->phase = PHASE_READY;
    }
    if (base->phase != PHASE_READY)
        return VS_ERR_SILENT;
    err = base->io.read(base->io.context, &stray, 1, 0);
    return err > 0 ? VS_ERR_GARBLED : err;
}

static int write_frame(struct vs_base *base, const struct vs_base_command *command,
                       uint8_t reset, uint64_t deadline_ns)
{
    struct epuck_argos_actuators actuators = {command->left_steps_s, command->right_steps_s,
                                              command->leds, 0, reset};
    uint8_t frame[EPUCK_ARGOS_ACTUATOR_LEN];

    epuck_argos_put_actuators(&actuators, frame);
    base->got = 0;
    base->written_ns = now(base);
    base->phase = PHASE_OWED;
    return base->io.write(base->io.context, frame, sizeof frame, deadline_ns);
}

static int decode(const struct vs_base *base, struct vs_base_reading *reading)
{
    struct epuck_argos_sensors sensors;
    size_t i;

    if (epuck_argos_get_sensors(base->frame, &sensors) != 0)
        return VS_ERR_GARBLED;
    for (i = 0; i < 8; i++) {
        reading->prox[i] = sensors.prox[i];
        reading->light[i] = (int16_t)(EPUCK_ARGOS_PROX_MAX - sensors.light[i]);
    }
    reading->battery_low = (uint8_t)sensors.battery_low;
    reading->battery_mv = 0;
    return VS_OK;
}

/* Keeps what exchange and close promise: after a failure only recovery helps. It
 * may still make use of a burst that is merely very late. */
static int settled(struct vs_base *base, int err)
{
    if (err != VS_OK && err != VS_ERR_BUSY && err != VS_ERR_SILENT)
        base->phase = PHASE_UNKNOWN;
    return err;
}

static int exchange_argos(struct vs_base *base, const struct vs_base_command *command,
                          struct vs_base_reading *reading)
{
    uint64_t deadline_ns = now(base) + EXCHANGE_NS;
    int err = settle(base, deadline_ns);

    if (err != VS_OK)
        return settled(base, err);
    err = write_frame(base, command, 0, deadline_ns);
    if (err == VS_OK)
        err = collect(base, deadline_ns);
    if (err == VS_ERR_BUSY)
        return VS_ERR_LATE;
    if (err == VS_OK) {
        base->phase = PHASE_READY;
        err = decode(base, reading);
    }
    return settled(base, err);
}

static int close_argos(struct vs_base *base)
{
    static const struct vs_base_command off;
    uint64_t deadline_ns = now(base) + EXCHANGE_NS;
    uint8_t stray;
    int err = settle(base, deadline_ns);

    if (err == VS_OK)
        err = write_frame(base, &off, EPUCK_ARGOS_RESET, deadline_ns);
    if (err != VS_OK)
        return settled(base, err);
    base->phase = PHASE_UNKNOWN;
    (void)base->io.read(base->io.context, &stray, 1, now(base) + LEAVE_NS);
    return VS_OK;
}

const struct vs_base_ops vs_base_argos = {
    "argos",
    "argos:DEVICE  e-puck with IRIDIA's firmware on a serial port, 115200 baud",
    open_argos,
    recover_argos,
    exchange_argos,
    close_argos,
};
