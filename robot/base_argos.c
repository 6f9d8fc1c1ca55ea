/* SPDX-License-Identifier: MIT */
/*
 * base_argos.c - IRIDIA's fixed-struct UART protocol (epuck_argos.h). The link has
 * no framing: the one thing that tells where the microcontroller stands is that it
 * sends 72 bytes right after the last byte of a frame. It must not be written to
 * while it sends. A byte too many on the line shifts all frames that follow: it is
 * found by holding back a frame's last byte now and then, for an answer that comes
 * before it, or by answers that are always late. Only zeros mean the same at every shift,
 * so a stop is three frames of them: after the first a frame may still hold what came
 * before. A microcontroller that was reset takes the next frame for its configuration,
 * which may switch on its own range-and-bearing: recovery ends with configuring it.
 */
#include "base_config.h"
#include "base_serial.h"

#include "../c_src/epuck_argos.h"
#include "../c_src/epuck_bytes.h"
#include "../c_src/vs_posix.h"

#define ROUND_NS 9000000u        /* [ns] a frame and its answer: 7.3 are the line's */
#define OWED_NS 100000000u       /* [ns] an answer that is later than this is none */
#define QUIET_NS 10000000u       /* [ns] longer than the 6.3 ms of a burst */
#define DRAIN_NS 40000000u       /* [ns] longest step of draining */
#define FEED_NS 15000000u        /* [ns] a burst comes within this or not at all */
#define PROMPT_NS 10000000u      /* [ns] an answer later than this proves nothing */
#define LEAVE_NS 3000000u        /* [ns] the line's time for a last frame */
#define HOLD_NS 4000000u         /* [ns] 11 bytes, and a serial driver's time for an answer */
#define GREET_NS 200000000u      /* [ns] it looks for the wake-up byte every 70 ms or so */
#define GREET_STEP_NS 80000000u  /* [ns] longest step of waiting for that */

enum {
    FEEDS_MAX = EPUCK_ARGOS_ACTUATOR_LEN,
    PROOFS = 2,
    STOP_FRAMES = 3,
    HOLD_EVERY = 5, /* exchange's frame has its last byte held back */
    LATES_MAX = 4,  /* in a row: as with infrared words that we never asked for */
    NO_BURST = 2 * EPUCK_ARGOS_SENSOR_LEN, /* as `got`: what is read proves nothing */
    PHASE_FEED = VS_SERIAL_OWN, /* recovery: byte by byte until a burst comes */
    PHASE_PROVE,                /* recovery: a burst came; is it where we think? */
    PHASE_RESET,                /* recovery: it is; let it wait for a configuration */
    PHASE_GREET                 /* recovery: it got one, of zeros */
};

struct argos {
    struct vs_serial line;
    uint8_t fed;         /* bytes fed without an answer */
    uint8_t proofs;      /* in a row that it stands where we think */
    uint8_t configured;  /* 1: its configuration is all zeros */
    uint16_t rab_received; /* as it was then */
    uint8_t rounds;      /* since a last byte was held back */
    uint8_t lates;       /* answers in a row that were too late for their exchange */
    uint8_t zero_sent;   /* 1: the newest frame was all zeros */
    uint8_t zeros;       /* frames of zeros in a row that were answered, up to STOP_FRAMES */
};

enum {
    STATE_FITS = 1 / (sizeof(struct argos) <= VS_BASE_STATE_MAX),
    ANSWER_FITS = 1 / (EPUCK_ARGOS_SENSOR_LEN <= VS_SERIAL_ANSWER_MAX)
};

static struct argos *of(struct vs_base *base)
{
    return (struct argos *)(void *)base->state.bytes;
}

static int open_argos(struct vs_base *base, const struct vs_base_config *config)
{
    struct vs_serial *line = vs_serial_of(base);

    line->wanted = EPUCK_ARGOS_SENSOR_LEN;
    line->owed_ns = OWED_NS;
    base->body = &vs_body_epuck;
    vs_posix_io(&base->io, &base->fd);
    return vs_posix_open_serial(config->device, EPUCK_ARGOS_BAUD, VS_BASE_LOCK_NS, &base->fd);
}

static int write_zeros(struct vs_base *base, size_t len)
{
    static const uint8_t zeros[EPUCK_ARGOS_ACTUATOR_LEN];

    return vs_serial_write(base, zeros, len, vs_serial_now(base) + FEED_NS);
}

/* Waits for silence. Exactly the burst that was owed before it tells as much as one
 * that was fed for. */
static int drain(struct vs_base *base)
{
    struct vs_serial *line = vs_serial_of(base);
    int err = vs_serial_drain(base, QUIET_NS, DRAIN_NS, NULL);

    if (err != VS_OK)
        return err;
    line->phase = line->got == EPUCK_ARGOS_SENSOR_LEN ? PHASE_PROVE : PHASE_FEED;
    return VS_ERR_BUSY;
}

/* One byte more: completes the frame, or the greeting, that it waits for? */
static int feed(struct vs_base *base)
{
    struct argos *a = of(base);
    int err = write_zeros(base, 1);

    if (err == VS_OK)
        err = vs_serial_collect(base, a->line.written_ns + FEED_NS);
    if (err == VS_OK) {
        a->line.phase = PHASE_PROVE;
        return VS_ERR_BUSY;
    }
    if (err != VS_ERR_BUSY)
        return err;
    if (a->line.got > 0) {
        a->line.phase = VS_SERIAL_QUIET;
        return VS_ERR_BUSY;
    }
    a->fed++;
    if (a->fed < FEEDS_MAX)
        return VS_ERR_BUSY;
    a->line.phase = VS_SERIAL_UNKNOWN;
    return VS_ERR_SILENT;
}

/* The zero-speed frame, its last byte held back: a burst before that byte means
 * that fed bytes had piled up behind a slow answer. Silence then proves the frame's
 * place only if the far end was awake, which a prompt answer to the last byte shows. */
static int prove(struct vs_base *base)
{
    struct argos *a = of(base);
    struct epuck_argos_sensors sensors;
    int err = write_zeros(base, EPUCK_ARGOS_ACTUATOR_LEN - 1);

    a->fed = 0;
    a->line.phase = VS_SERIAL_QUIET;
    if (err == VS_OK)
        err = vs_serial_collect(base, a->line.written_ns + FEED_NS);
    if (err != VS_ERR_BUSY || a->line.got > 0) {
        a->proofs = 0;
        return err == VS_OK ? VS_ERR_BUSY : err;
    }
    err = write_zeros(base, 1);
    if (err == VS_OK)
        err = vs_serial_collect(base, a->line.written_ns + VS_BASE_EXCHANGE_NS);
    if (err == VS_OK && epuck_argos_get_sensors(a->line.answer, &sensors) != 0)
        err = VS_ERR_BUSY;
    if (err == VS_OK)
        a->rab_received = sensors.rab_received;
    a->proofs++;
    if (err != VS_OK || vs_serial_now(base) >= a->line.written_ns + PROMPT_NS)
        a->proofs = 0;
    if (err != VS_OK)
        return err;
    a->line.phase = PHASE_PROVE;
    if (a->proofs < PROOFS)
        return VS_ERR_BUSY;
    a->line.phase = a->configured ? VS_SERIAL_READY : PHASE_RESET;
    a->zeros = STOP_FRAMES; /* it stands where we think, and has got nothing else */
    return a->configured ? VS_OK : VS_ERR_BUSY;
}

/* It stands where we think: 'R', which nothing answers, then wake-up and configuration. */
static int reset(struct vs_base *base)
{
    static const uint8_t frame[EPUCK_ARGOS_ACTUATOR_LEN] = {[EPUCK_ARGOS_RESET_AT] =
                                                                EPUCK_ARGOS_RESET};
    struct argos *a = of(base);
    int err = vs_serial_write(base, frame, sizeof frame, vs_serial_now(base) + FEED_NS);

    a->proofs = 0;
    a->line.phase = VS_SERIAL_QUIET;
    if (err == VS_OK)
        err = vs_serial_collect(base, a->line.written_ns + FEED_NS);
    if (err != VS_ERR_BUSY || a->line.got > 0)
        return err == VS_OK ? VS_ERR_BUSY : err;
    a->line.phase = PHASE_GREET;
    err = write_zeros(base, 1 + EPUCK_ARGOS_CONFIG_LEN);
    return err == VS_OK ? VS_ERR_BUSY : err;
}

/* Its burst says that it is configured; one more proof, and it is found. */
static int greet(struct vs_base *base)
{
    struct argos *a = of(base);
    int err = vs_serial_collect(base, vs_serial_now(base) + GREET_STEP_NS);

    if (err == VS_OK) {
        a->configured = 1;
        a->proofs = PROOFS - 1;
        a->line.phase = PHASE_PROVE;
        return VS_ERR_BUSY;
    }
    if (err == VS_ERR_BUSY && vs_serial_now(base) >= a->line.written_ns + GREET_NS) {
        a->line.phase = VS_SERIAL_UNKNOWN;
        return VS_ERR_SILENT;
    }
    return err;
}

static int recover_argos(struct vs_base *base)
{
    struct argos *a = of(base);

    switch (a->line.phase) {
    case PHASE_FEED:
        return feed(base);
    case PHASE_PROVE:
        return prove(base);
    case PHASE_RESET:
        return reset(base);
    case PHASE_GREET:
        return greet(base);
    case VS_SERIAL_QUIET:
        return drain(base);
    default:
        if (a->line.phase != VS_SERIAL_OWED)
            a->line.got = NO_BURST;
        a->fed = 0;
        a->proofs = 0;
        a->configured = 0;
        a->line.phase = VS_SERIAL_QUIET;
        return drain(base);
    }
}

/* The burst is complete: the frame before it was applied. */
static void answered(struct argos *a)
{
    a->line.phase = VS_SERIAL_READY;
    if (!a->zero_sent)
        a->zeros = 0;
    else if (a->zeros < STOP_FRAMES)
        a->zeros++;
}

/* Makes sure that the microcontroller waits for a frame. */
static int settle(struct vs_base *base, uint64_t deadline_ns)
{
    struct argos *a = of(base);

    if (a->line.phase == VS_SERIAL_OWED) {
        int err = vs_serial_await(base, deadline_ns);

        if (err != VS_OK)
            return err;
        answered(a);
    }
    return a->line.phase == VS_SERIAL_READY ? VS_OK : VS_ERR_SILENT;
}

/* Writes a frame but for its last byte, for which the far end has to wait: no byte that is on
 * the line before that is an answer. */
static int hold_back(struct vs_base *base, const uint8_t frame[EPUCK_ARGOS_ACTUATOR_LEN],
                     uint64_t deadline_ns)
{
    uint8_t stray;
    int err = vs_serial_write(base, frame, EPUCK_ARGOS_ACTUATOR_LEN - 1, deadline_ns);

    if (err != VS_OK)
        return err;
    /* As for an answer: the line stays set up for that, and with the deadline a part shows. */
    if (base->io.expect != NULL)
        base->io.expect(base->io.context, EPUCK_ARGOS_SENSOR_LEN);
    err = base->io.read(base->io.context, &stray, 1, vs_serial_now(base) + HOLD_NS);
    return err > 0 ? VS_ERR_GARBLED : err;
}

static int write_frame(struct vs_base *base, const struct vs_base_command *command,
                       uint8_t reset, uint64_t deadline_ns)
{
    struct argos *a = of(base);
    struct epuck_argos_actuators actuators = {command->left_steps_s, command->right_steps_s,
                                              command->leds, 0, reset};
    int zero = (actuators.left_steps_s | actuators.right_steps_s | actuators.leds | reset) == 0;
    int hold = !zero && reset == 0 && ++a->rounds >= HOLD_EVERY &&
               vs_serial_now(base) + HOLD_NS <= deadline_ns;
    uint8_t frame[EPUCK_ARGOS_ACTUATOR_LEN];
    size_t held = 0;
    int err = hold ? VS_OK : vs_serial_is_clear(base);

    if (err != VS_OK)
        return err;
    epuck_argos_put_actuators(&actuators, frame);
    a->zero_sent = (uint8_t)zero;
    a->line.phase = VS_SERIAL_OWED;
    if (hold) {
        a->rounds = 0;
        held = sizeof frame - 1;
        err = hold_back(base, frame, deadline_ns);
    }
    if (err != VS_OK)
        return err;
    return vs_serial_write(base, frame + held, sizeof frame - held, deadline_ns);
}

/* Its own range-and-bearing can only begin to hear something if a frame of ours became its
 * configuration: it was reset. */
static int decode(struct vs_base *base, struct epuck_argos_sensors *sensors)
{
    if (epuck_argos_get_sensors(of(base)->line.answer, sensors) != 0)
        return VS_ERR_GARBLED;
    if (sensors->rab_received == of(base)->rab_received)
        return VS_OK;
    base->news = "its microcontroller was reset";
    base->resets++;
    return VS_ERR_GARBLED;
}

static void report(const struct epuck_argos_sensors *sensors, struct vs_base_reading *reading)
{
    vs_base_see(sensors->prox, sensors->light, EPUCK_ARGOS_RAW_MAX, reading);
    vs_base_feel(sensors->acceleration, sensors->microphones, 3, reading);
    reading->battery_low = !sensors->battery_good;
    reading->battery_mv = 0;
}

/* Keeps what exchange and close promise: after a failure only recovery helps. It
 * may still make use of a burst that is merely very late. */
static int settled(struct vs_base *base, int err)
{
    struct argos *a = of(base);

    if (err != VS_OK && err != VS_ERR_BUSY && err != VS_ERR_SILENT)
        a->line.phase = VS_SERIAL_UNKNOWN;
    return err;
}

/* One frame and its answer. */
static int go_round(struct vs_base *base, const struct vs_base_command *command,
                    struct epuck_argos_sensors *sensors, uint64_t deadline_ns)
{
    struct argos *a = of(base);
    int err = write_frame(base, command, 0, deadline_ns);

    if (err == VS_OK)
        err = vs_serial_collect(base, deadline_ns);
    if (err == VS_ERR_BUSY && ++a->lates < LATES_MAX)
        return VS_ERR_LATE;
    a->lates = 0;
    if (err == VS_OK) {
        answered(a);
        err = decode(base, sensors);
    }
    return settled(base, err == VS_ERR_BUSY ? VS_ERR_GARBLED : err);
}

static int exchange_argos(struct vs_base *base, const struct vs_base_command *command,
                          struct vs_base_reading *reading)
{
    struct argos *a = of(base);
    uint64_t deadline_ns = vs_serial_now(base) + VS_BASE_EXCHANGE_NS;
    struct epuck_argos_sensors sensors;
    int err = settle(base, deadline_ns);

    if (err != VS_OK)
        return settled(base, err);
    do {
        err = go_round(base, command, &sensors, deadline_ns);
        if (err != VS_OK)
            return err;
    } while (a->zero_sent && a->zeros < STOP_FRAMES &&
             vs_serial_now(base) + ROUND_NS <= deadline_ns);
    if (a->zero_sent && a->zeros < STOP_FRAMES)
        return VS_ERR_LATE;
    report(&sensors, reading);
    return VS_OK;
}

static int close_argos(struct vs_base *base)
{
    struct argos *a = of(base);
    static const struct vs_base_command off;
    uint64_t deadline_ns = vs_serial_now(base) + VS_BASE_EXCHANGE_NS;
    uint8_t stray;
    int err = settle(base, deadline_ns);

    if (err == VS_OK)
        err = write_frame(base, &off, EPUCK_ARGOS_RESET, deadline_ns);
    if (err != VS_OK)
        return settled(base, err);
    a->line.phase = VS_SERIAL_UNKNOWN;
    (void)base->io.read(base->io.context, &stray, 1, vs_serial_now(base) + LEAVE_NS);
    return VS_OK;
}

static const struct vs_base_choice choices[] = {{NULL, NULL}};

const struct vs_base_ops vs_base_argos = {
    "argos",
    "argos:DEVICE  e-puck with IRIDIA's firmware on a serial port, 115200 baud",
    "/dev/ttyS0",
    0,
    choices,
    open_argos,
    recover_argos,
    exchange_argos,
    close_argos,
};
