/* SPDX-License-Identifier: MIT */
/*
 * base_asercom.c - GCtronic's advanced sercom (epuck_asercom.h). Every packet sets the
 * speeds and ends with asking for them: the answer's length and its last four bytes
 * prove that nothing was lost on either way. LEDs cannot be asked for, so beside those
 * that change one is set again with every packet. The far end has a receive ring of 64
 * bytes: the next packet waits for the answer to the one before.
 */
#include "base_config.h"

#include "../c_src/epuck_asercom.h"
#include "../c_src/vs_posix.h"

#define DRAIN_NS 40000000u /* [ns] longest step of draining */
#define STEP_NS 30000000u  /* [ns] longest step of waiting for an answer */

enum {
    PHASE_UNKNOWN = 0, /* nobody knows what its parser waits for */
    PHASE_READY,       /* it is idle and nothing is unread */
    PHASE_OWED,        /* it got a packet, its answer is not complete */
    PHASE_QUIET,       /* recovery: waiting for silence */
    PHASE_VERSION,     /* recovery: its version was asked for */
    PHASE_PROVE        /* recovery: its parser is idle; does it answer as this mode does? */
};

/* How patient a mode has to be: Bluetooth delays, and comes in bursts. */
static const struct {
    uint32_t quiet_ns; /* [ns] silence that ends a text */
    uint32_t owed_ns;  /* [ns] an answer that is later than this is none */
} patience[EPUCK_ASERCOM_MODES] = {
    {10000000, 60000000},
    {40000000, 150000000},
    {40000000, 150000000},
};

struct asercom {
    const struct epuck_asercom_mode *mode;
    uint32_t quiet_ns;
    uint32_t owed_ns;
    uint8_t phase;
    uint8_t matched;   /* bytes of EPUCK_ASERCOM_VERSION that came just now */
    uint8_t versions;  /* times that it came */
    uint8_t refreshed; /* LED that was set again last */
    uint8_t closing;   /* the packet that is owed an answer was a clean end's */
    size_t got;        /* bytes of the present answer */
    uint64_t written_ns;
    int16_t left_steps_s; /* of the packet before it */
    int16_t right_steps_s;
    uint16_t leds;     /* lit, as far as its packets were understood */
    uint8_t reply[EPUCK_ASERCOM_REPLY_MAX];
};

enum { STATE_FITS = 1 / (sizeof(struct asercom) <= VS_BASE_STATE_MAX) };

static struct asercom *of(struct vs_base *base)
{
    return (struct asercom *)(void *)base->state.bytes;
}

static uint64_t now(const struct vs_base *base)
{
    return base->io.now_ns(base->io.context);
}

static int open_asercom(struct vs_base *base, const struct vs_base_config *config)
{
    struct asercom *a = of(base);
    uint8_t mode = config->choice[0];

    a->mode = &epuck_asercom_modes[mode];
    a->quiet_ns = patience[mode].quiet_ns;
    a->owed_ns = patience[mode].owed_ns;
    base->body = &vs_body_epuck;
    vs_posix_io(&base->io, &base->fd);
    return vs_posix_open_serial(config->device, a->mode->baud, VS_BASE_LOCK_NS, &base->fd);
}

/* Reads on until the answer is complete (VS_OK) or time is up (VS_ERR_BUSY). */
static int collect(struct vs_base *base, uint64_t deadline_ns)
{
    struct asercom *a = of(base);
    size_t wanted = epuck_asercom_reply_len(a->mode);

    while (a->got < wanted) {
        int len = base->io.read(base->io.context, a->reply + a->got, wanted - a->got, deadline_ns);

        if (len < 0)
            return len;
        if (len == 0)
            return VS_ERR_BUSY;
        a->got += (size_t)len;
    }
    return VS_OK;
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

    a->got = 0;
    a->left_steps_s = command->left_steps_s;
    a->right_steps_s = command->right_steps_s;
    a->leds = command->leds;
    a->written_ns = now(base);
    a->phase = PHASE_OWED;
    return base->io.write(base->io.context, packet, len, deadline_ns);
}

/* The answer is complete: is it one, and does it say that the packet was understood? */
static int decode(struct asercom *a, struct epuck_asercom_sensors *sensors)
{
    if (epuck_asercom_get_reply(a->mode, a->reply, sensors) != 0 ||
        sensors->left_steps_s != a->left_steps_s || sensors->right_steps_s != a->right_steps_s)
        return VS_ERR_GARBLED;
    a->phase = PHASE_READY;
    return VS_OK;
}

/* How often the far end's version came in what was read. */
static void match_version(struct asercom *a, const uint8_t *buf, size_t len)
{
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

/* Reads whatever comes. VS_OK: it was silent for long enough; VS_ERR_BUSY: not yet. */
static int drain(struct vs_base *base)
{
    struct asercom *a = of(base);
    uint64_t until_ns = now(base) + DRAIN_NS;

    while (now(base) < until_ns) {
        uint8_t scrap[EPUCK_ASERCOM_REPLY_MAX];
        int len = base->io.read(base->io.context, scrap, sizeof scrap, now(base) + a->quiet_ns);

        if (len <= 0)
            return len;
        match_version(a, scrap, (size_t)len);
    }
    return VS_ERR_BUSY;
}

/* From whatever it waits for back to idle, where it says its version. */
static int ask_version(struct vs_base *base)
{
    struct asercom *a = of(base);

    a->phase = PHASE_VERSION;
    a->matched = 0;
    a->versions = 0;
    a->written_ns = now(base);
    return base->io.write(base->io.context, epuck_asercom_resync, EPUCK_ASERCOM_RESYNC_LEN,
                          a->written_ns + STEP_NS);
}

/* Recovery: its answer to the last question does not come, or makes no sense. */
static int start_over(struct asercom *a, int err)
{
    a->phase = PHASE_UNKNOWN;
    return err;
}

static int await_version(struct vs_base *base)
{
    struct asercom *a = of(base);
    int err = drain(base);

    if (err != VS_OK)
        return err;
    if (a->versions > 0) {
        a->phase = PHASE_PROVE;
        return VS_ERR_BUSY;
    }
    if (now(base) < a->written_ns + a->owed_ns)
        return VS_ERR_BUSY;
    return start_over(a, VS_ERR_SILENT);
}

/* Says what an answer of another length means. */
static const char *blame(const struct asercom *a, size_t got)
{
    const struct epuck_asercom_mode *modes = epuck_asercom_modes;

    if (got == epuck_asercom_reply_len(&modes[EPUCK_ASERCOM_EXTENSION]))
        return "it answers as with its selector at 10: expected mode=extension";
    if (a->mode->ground > 0 &&
        got == epuck_asercom_reply_len(a->mode) - a->mode->ground + EPUCK_ASERCOM_NO_GROUND)
        return "its firmware knows no ground sensors: expected mode=bluetooth";
    if (got == epuck_asercom_reply_len(&modes[EPUCK_ASERCOM_BLUETOOTH]))
        return "it answers as over Bluetooth: turn its selector to 10, or use mode=bluetooth";
    return "it answers with an unknown number of bytes: expected firmware with advanced sercom";
}

/* Counts what comes until it is silent. Returns the number, or an error. */
static int count_more(struct vs_base *base)
{
    uint64_t until_ns = now(base) + STEP_NS;
    uint8_t more[EPUCK_ASERCOM_REPLY_MAX];
    int count = 0;
    int len;

    do {
        len = base->io.read(base->io.context, more, sizeof more,
                            now(base) + of(base)->quiet_ns / 2);
        if (len < 0)
            return len;
        count += len;
    } while (len > 0 && now(base) < until_ns);
    return count;
}

/* Wheels 0, LEDs off, and the answer has to be as long as this mode's. */
static int prove(struct vs_base *base)
{
    static const struct vs_base_command off;
    struct asercom *a = of(base);
    struct epuck_asercom_sensors sensors;
    int err = write_poll(base, &off, VS_BASE_LEDS, now(base) + STEP_NS);
    int extra;

    if (err == VS_OK)
        err = collect(base, now(base) + STEP_NS);
    if (err == VS_ERR_BUSY && a->got == 0)
        return start_over(a, VS_ERR_SILENT);
    if (err != VS_OK && err != VS_ERR_BUSY)
        return err;
    extra = count_more(base);
    if (extra < 0)
        return extra;
    if (err == VS_OK && extra == 0 && decode(a, &sensors) == VS_OK)
        return VS_OK;
    base->news = blame(a, a->got + (size_t)extra);
    return start_over(a, VS_ERR_SILENT);
}

static int recover_asercom(struct vs_base *base)
{
    struct asercom *a = of(base);
    int err;

    if (a->phase == PHASE_VERSION)
        return await_version(base);
    if (a->phase == PHASE_PROVE)
        return prove(base);
    a->phase = PHASE_QUIET;
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
    uint8_t stray;
    int err;

    if (a->phase == PHASE_OWED) {
        err = collect(base, deadline_ns);
        if (err == VS_ERR_BUSY && now(base) < a->written_ns + a->owed_ns)
            return VS_ERR_BUSY;
        if (err == VS_OK)
            err = decode(a, sensors);
        if (err != VS_OK)
            return err == VS_ERR_BUSY ? VS_ERR_SILENT : err;
    }
    if (a->phase != PHASE_READY)
        return VS_ERR_SILENT;
    err = base->io.read(base->io.context, &stray, 1, 0);
    return err > 0 ? VS_ERR_GARBLED : err;
}

/* After a failure only recovery helps. */
static int settled(struct asercom *a, int err)
{
    if (err != VS_OK && err != VS_ERR_BUSY && err != VS_ERR_LATE)
        a->phase = PHASE_UNKNOWN;
    return err;
}

static void report(struct vs_base *base, const struct epuck_asercom_sensors *sensors,
                   struct vs_base_reading *reading)
{
    size_t i;

    for (i = 0; i < 8; i++) {
        reading->prox[i] = sensors->prox[i];
        reading->light[i] = (int16_t)(EPUCK_ASERCOM_RAW_MAX - sensors->light[i]);
    }
    reading->battery_low = epuck_asercom_battery_low(sensors->battery);
    reading->battery_mv = epuck_asercom_battery_mv(sensors->battery);
    vs_base_count(base, sensors->steps, reading);
    if (of(base)->mode->ground == 0)
        return;
    base->boards.reading.there |= 1u << VS_BOARD_GROUND;
    base->boards.reading.has_ground = 1;
    for (i = 0; i < 3; i++)
        base->boards.reading.ground[i] = sensors->ground[i];
}

/* Commands, and waits for the answer that proves it. */
static int go_round(struct vs_base *base, const struct vs_base_command *command, uint16_t change,
                    struct epuck_asercom_sensors *sensors, uint64_t deadline_ns)
{
    struct asercom *a = of(base);
    int err = write_poll(base, command, change, deadline_ns);

    if (err == VS_OK)
        err = collect(base, deadline_ns);
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
    uint64_t deadline_ns = now(base) + VS_BASE_EXCHANGE_NS;
    int was_owed = a->phase == PHASE_OWED;
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
    uint64_t deadline_ns = now(base) + VS_BASE_EXCHANGE_NS;
    int was_owed = a->phase == PHASE_OWED;
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
static const struct vs_base_choice choices[] = {{"mode", modes}, {NULL, NULL}};

const struct vs_base_ops vs_base_asercom = {
    "asercom",
    "asercom:DEVICE  e-puck with GCtronic's firmware on a serial port\n"
    "    mode=extension         selector 10, extension connector, 230400 baud (default)\n"
    "    mode=bluetooth         selector 3, Bluetooth, 115200 baud\n"
    "    mode=bluetooth+ground  the same with ground sensors",
    "/dev/ttyS1",
    0,
    choices,
    open_asercom,
    recover_asercom,
    exchange_asercom,
    close_asercom,
};
