/* SPDX-License-Identifier: MIT */
/*
 * base_asercom.c - GCtronic's advanced sercom (epuck_asercom.h). Every packet sets the
 * speeds and ends with asking for them: the answer's length and its last four bytes
 * prove that nothing was lost on either way. LEDs cannot be asked for, so beside those
 * that change one is set again with every packet. The far end has a receive ring of 64
 * bytes: the next packet waits for the answer to the one before.
 */
#include <string.h>

#include "base_config.h"
#include "base_serial.h"

#include "../c_src/epuck_asercom.h"
#include "../c_src/vs_posix.h"

#define DRAIN_NS 40000000u /* [ns] longest step of draining */
#define STEP_NS 30000000u  /* [ns] longest step of waiting for an answer */
#define OTHER_ROBOT_LEN 2u /* [byte] that the other model's answer is shorter by */

enum {
    PHASE_VERSION = VS_SERIAL_OWN, /* recovery: its version was asked for */
    PHASE_PROVE /* recovery: its parser is idle; does it answer as this mode does? */
};

/* How patient a mode has to be: Bluetooth delays, and comes in bursts. */
static const struct {
    uint32_t quiet_ns; /* [ns] silence that ends a text */
    uint32_t owed_ns;  /* [ns] an answer that is later than this is none */
} patience[] = {
    {10000000, 60000000},
    {40000000, 150000000},
    {40000000, 150000000},
};

struct asercom {
    struct vs_serial line;
    const struct epuck_asercom_mode *mode;
    uint32_t quiet_ns;
    uint8_t matched;   /* bytes of EPUCK_ASERCOM_VERSION that came just now */
    uint8_t versions;  /* times that it came */
    uint8_t refreshed; /* LED that was set again last */
    uint8_t is_epuck2;
    uint8_t closing;   /* the packet that is owed an answer was a clean end's */
    int16_t left_steps_s; /* of the packet before it */
    int16_t right_steps_s;
    uint16_t leds;     /* lit, as far as its packets were understood */
};

enum {
    STATE_FITS = 1 / (sizeof(struct asercom) <= VS_BASE_STATE_MAX),
    ANSWER_FITS = 1 / (EPUCK_ASERCOM_REPLY_MAX <= VS_SERIAL_ANSWER_MAX)
};

static struct asercom *of(struct vs_base *base)
{
    return (struct asercom *)(void *)base->state.bytes;
}

static int open_asercom(struct vs_base *base, const struct vs_base_config *config)
{
    struct asercom *a = of(base);
    uint8_t mode = config->choice[0];

    a->quiet_ns = patience[mode].quiet_ns;
    a->line.owed_ns = patience[mode].owed_ns;
    a->is_epuck2 = config->choice[1] == 1;
    if (a->is_epuck2 && mode != EPUCK_ASERCOM_EXTENSION)
        mode = (uint8_t)(mode + EPUCK_ASERCOM_EPUCK2 - EPUCK_ASERCOM_BLUETOOTH);
    a->mode = &epuck_asercom_modes[mode];
    a->line.wanted = (uint8_t)epuck_asercom_reply_len(a->mode);
    base->body = a->is_epuck2 ? &vs_body_epuck2 : &vs_body_epuck;
    vs_posix_io(&base->io, &base->fd);
    return vs_posix_open_serial(config->device, a->mode->baud, VS_BASE_LOCK_NS, &base->fd);
}

/* Writes a packet that lets the far end do as commanded; sets the LEDs in change. */
static int write_poll(struct vs_base *base, const struct vs_base_command *command,
                      uint16_t change, uint64_t deadline_ns)
{
    struct asercom *a = of(base);
    struct epuck_asercom_poll poll = {command->left_steps_s, command->right_steps_s,
                                      command->leds, change};
    uint8_t packet[EPUCK_ASERCOM_REQUEST_MAX];
    size_t len = epuck_asercom_put_poll(a->mode, &poll, packet);

    a->left_steps_s = command->left_steps_s;
    a->right_steps_s = command->right_steps_s;
    a->leds = command->leds;
    a->line.phase = VS_SERIAL_OWED;
    return vs_serial_write(base, packet, len, deadline_ns);
}

/* The answer is complete: is it one, and does it say that the packet was understood? */
static int decode(struct asercom *a, struct epuck_asercom_sensors *sensors)
{
    if (epuck_asercom_get_reply(a->mode, a->line.answer, sensors) != 0 ||
        sensors->left_steps_s != a->left_steps_s || sensors->right_steps_s != a->right_steps_s)
        return VS_ERR_GARBLED;
    a->line.phase = VS_SERIAL_READY;
    return VS_OK;
}

/* How often the far end's version came in what was read. */
static void match_version(struct vs_base *base, const uint8_t *buf, size_t len)
{
    struct asercom *a = of(base);
    static const char version[] = EPUCK_ASERCOM_VERSION;
    size_t i;

    for (i = 0; i < len; i++) {
        a->matched = buf[i] == (uint8_t)version[a->matched] ? (uint8_t)(a->matched + 1)
                                                            : buf[i] == (uint8_t)version[0];
        if (version[a->matched] == '\0') {
            a->versions = 1;
            a->matched = 0;
        }
    }
}

static int drain(struct vs_base *base)
{
    return vs_serial_drain(base, of(base)->quiet_ns, DRAIN_NS, match_version);
}

/* From whatever it waits for back to idle, where it says its version. */
static int ask_version(struct vs_base *base)
{
    struct asercom *a = of(base);

    a->line.phase = PHASE_VERSION;
    a->matched = 0;
    a->versions = 0;
    return vs_serial_write(base, epuck_asercom_resync, EPUCK_ASERCOM_RESYNC_LEN,
                           vs_serial_now(base) + STEP_NS);
}

/* Recovery: its answer to the last question does not come, or makes no sense. */
static int start_over(struct asercom *a, int err)
{
    a->line.phase = VS_SERIAL_UNKNOWN;
    return err;
}

static int await_version(struct vs_base *base)
{
    struct asercom *a = of(base);
    int err = drain(base);

    if (err != VS_OK)
        return err;
    if (a->versions > 0) {
        a->line.phase = PHASE_PROVE;
        return VS_ERR_BUSY;
    }
    if (vs_serial_now(base) < a->line.written_ns + a->line.owed_ns)
        return VS_ERR_BUSY;
    return start_over(a, VS_ERR_SILENT);
}

/* Says what an answer of another length means. */
static const char *blame(const struct asercom *a, size_t got)
{
    const struct epuck_asercom_mode *modes = epuck_asercom_modes;

    if (got + OTHER_ROBOT_LEN == epuck_asercom_reply_len(a->mode))
        return a->mode->epuck2 > 0 ? "it is an e-puck: expected model=epuck"
                                   : "it is an e-puck2: expected model=epuck2";
    if (got == epuck_asercom_reply_len(&modes[EPUCK_ASERCOM_EXTENSION]))
        return "it answers as with its selector at 10: expected mode=extension";
    if (a->mode->ground > 0 &&
        got == epuck_asercom_reply_len(a->mode) - a->mode->ground + EPUCK_ASERCOM_NO_GROUND)
        return "its firmware knows no ground sensors: expected mode=bluetooth";
    if (got == epuck_asercom_reply_len(&modes[EPUCK_ASERCOM_BLUETOOTH]))
        return "it answers as over Bluetooth: turn its selector to 10, or use mode=bluetooth";
    return "it answers with an unknown number of bytes: expected firmware with advanced sercom";
}

/* Wheels 0, LEDs off, and the answer has to be as long as this mode's. */
static int prove(struct vs_base *base)
{
    static const struct vs_base_command off;
    struct asercom *a = of(base);
    struct epuck_asercom_sensors sensors;
    int err = write_poll(base, &off, VS_BASE_LEDS, vs_serial_now(base) + STEP_NS);
    int in_time;

    if (err == VS_OK)
        err = vs_serial_collect(base, vs_serial_now(base) + STEP_NS);
    in_time = err == VS_OK;
    if (err == VS_ERR_BUSY && a->line.got == 0)
        return start_over(a, VS_ERR_SILENT);
    if (err == VS_OK || err == VS_ERR_BUSY)
        err = vs_serial_drain(base, a->quiet_ns / 2, STEP_NS, NULL);
    if (err != VS_OK && err != VS_ERR_BUSY)
        return err;
    if (in_time && a->line.got == a->line.wanted && decode(a, &sensors) == VS_OK)
        return VS_OK;
    base->news = blame(a, a->line.got);
    return start_over(a, VS_ERR_SILENT);
}

static int recover_asercom(struct vs_base *base)
{
    struct asercom *a = of(base);
    int err;

    if (a->line.phase == PHASE_VERSION)
        return await_version(base);
    if (a->line.phase == PHASE_PROVE)
        return prove(base);
    a->line.phase = VS_SERIAL_QUIET;
    a->closing = 0;
    err = drain(base);
    if (err == VS_OK)
        err = ask_version(base);
    return err == VS_OK ? VS_ERR_BUSY : err;
}

/* Makes sure that the parser is idle and nothing is unread. An answer that was owed goes
 * to *sensors. */
static int settle(struct vs_base *base, struct epuck_asercom_sensors *sensors,
                  uint64_t deadline_ns)
{
    struct asercom *a = of(base);

    if (a->line.phase == VS_SERIAL_OWED) {
        int err = vs_serial_await(base, deadline_ns);

        if (err == VS_OK)
            err = decode(a, sensors);
        if (err != VS_OK)
            return err;
    }
    return vs_serial_is_clear(base);
}

/* After a failure only recovery helps. */
static int settled(struct asercom *a, int err)
{
    if (err != VS_OK && err != VS_ERR_BUSY && err != VS_ERR_LATE)
        a->line.phase = VS_SERIAL_UNKNOWN;
    return err;
}

static void report(struct vs_base *base, const struct epuck_asercom_sensors *sensors,
                   struct vs_base_reading *reading)
{
    const struct asercom *a = of(base);
    size_t i;

    vs_base_see(sensors->prox, sensors->light, EPUCK_ASERCOM_RAW_MAX, reading);
    reading->battery_low = epuck_asercom_battery_low(sensors->battery, a->is_epuck2);
    reading->battery_mv = epuck_asercom_battery_mv(sensors->battery, a->is_epuck2);
    vs_base_count(base, sensors->steps, reading);
    reading->distance_mm = sensors->distance_mm;
    reading->has_rates = reading->has_distance = a->mode->epuck2;
    memcpy(reading->rates, sensors->rates, sizeof reading->rates);
    if (a->mode->ground == 0)
        return;
    reading->has_ground = 1;
    for (i = 0; i < 3; i++)
        reading->ground[i] = sensors->ground[i];
}

/* Commands, and waits for the answer that proves it. */
static int go_round(struct vs_base *base, const struct vs_base_command *command, uint16_t change,
                    struct epuck_asercom_sensors *sensors, uint64_t deadline_ns)
{
    struct asercom *a = of(base);
    int err = write_poll(base, command, change, deadline_ns);

    if (err == VS_OK)
        err = vs_serial_collect(base, deadline_ns);
    if (err == VS_ERR_BUSY)
        return VS_ERR_LATE;
    return err == VS_OK ? decode(a, sensors) : err;
}

/* 1 if the newest packet said the same. */
static int is_said(const struct asercom *a, const struct vs_base_command *command)
{
    return command->left_steps_s == a->left_steps_s &&
           command->right_steps_s == a->right_steps_s && command->leds == a->leds;
}

/* A late answer to the same command is as good as one of its own: with a link that is
 * slower than an exchange may be there would never be another. */
static int exchange_asercom(struct vs_base *base, const struct vs_base_command *command,
                            struct vs_base_reading *reading)
{
    struct asercom *a = of(base);
    uint64_t deadline_ns = vs_serial_now(base) + VS_BASE_EXCHANGE_NS;
    int was_owed = a->line.phase == VS_SERIAL_OWED;
    struct epuck_asercom_sensors sensors;
    int err = settle(base, &sensors, deadline_ns);
    uint16_t change;

    if (err == VS_OK && !(was_owed && is_said(a, command))) {
        a->refreshed = (uint8_t)((a->refreshed + 1) % EPUCK_ASERCOM_LEDS);
        change = (uint16_t)((a->leds ^ command->leds) | 1u << a->refreshed);
        a->closing = 0;
        err = go_round(base, command, change, &sensors, deadline_ns);
    }
    if (err == VS_OK)
        report(base, &sensors, reading);
    return settled(a, err);
}

/* The firmware has no clean end: idle, at rest, LEDs off is how its next host finds it. */
static int close_asercom(struct vs_base *base)
{
    static const struct vs_base_command off;
    struct asercom *a = of(base);
    uint64_t deadline_ns = vs_serial_now(base) + VS_BASE_EXCHANGE_NS;
    int was_owed = a->line.phase == VS_SERIAL_OWED;
    struct epuck_asercom_sensors sensors;
    int err = settle(base, &sensors, deadline_ns);

    if (err == VS_OK && !(was_owed && a->closing)) {
        a->closing = 1;
        err = go_round(base, &off, VS_BASE_LEDS, &sensors, deadline_ns);
    }
    err = settled(a, err);
    return err == VS_ERR_LATE ? VS_ERR_BUSY : err;
}

static const char *const modes[] = {"extension", "bluetooth", "bluetooth+ground", NULL};
static const char *const models[] = {"epuck", "epuck2", NULL};
static const struct vs_base_choice choices[] = {{"mode", modes}, {"model", models}, {NULL, NULL}};

const struct vs_base_ops vs_base_asercom = {
    "asercom",
    "asercom:DEVICE  e-puck with GCtronic's firmware on a serial port\n"
    "    mode=extension         selector 10, extension connector, 230400 baud (default)\n"
    "    mode=bluetooth         selector 3, Bluetooth, 115200 baud\n"
    "    mode=bluetooth+ground  the same with ground sensors\n"
    "    model=epuck            its wheels and motors (default)\n"
    "    model=epuck2           those of an e-puck2, gyroscope, distance",
    "/dev/ttyS1",
    0,
    choices,
    open_asercom,
    recover_asercom,
    exchange_asercom,
    close_asercom,
};
