/* SPDX-License-Identifier: MIT */
/*
 * base_york.c - York's register map over I2C (epuck_york.h). There is no checksum, so
 * speeds and LEDs are read back whenever they were written, and in turns, the switch of
 * the IR sensors always: a write that was lost is repeated, and a microcontroller that
 * was reset is noticed. An exchange takes a dozen transactions; what there is no time for goes on
 * with the next call.
 * An e-puck2 does not apply what is written next after an error on the bus, and says that
 * it did: it is told everything twice, and once more after an error.
 */
#include "base_config.h"

#include "../c_src/epuck_bytes.h"
#include "../c_src/epuck_york.h"
#include "../c_src/vs_i2c_posix.h"

#define RECOVER_NS 90000000u /* [ns] longest step of recovery */
#define SENSE_NS 12000000u   /* [ns] from switching on: all sensors have measured */

enum {
    FAILURES_MAX = 3,
    READS_MAX = 3,   /* of a counter that cannot be right */
    RING_MASK = 0xFF,
    UNKNOWN_LEDS = 0xFFFF,
    SPARE_STEPS = 8, /* a counter may be this far from where the speed limit says */
    SIDES = 2,
    /* registers that are read back: the speeds of both sides, and */
    CHECK_SENSING = 2,
    CHECK_RING,
    CHECK_OTHER,
    CHECKED,
    /* what an exchange reads, in this order */
    READ_STEPS = 0,
    READ_PROX = 2,
    READ_LIGHT = 10, /* one sensor: light changes slowly */
    READ_END = 11
};

struct york {
    uint8_t is_epuck2;
    uint8_t found;
    uint8_t failures;    /* in a row */
    uint8_t turn;        /* which register is read back next */
    uint8_t unchecked;   /* bit n: checked[n] was written and is to be read back */
    uint8_t next;        /* READ_STEPS..READ_END: what this exchange reads next */
    uint8_t light;       /* the light sensor to be read next */
    uint16_t leds;       /* as written */
    int16_t speeds[SIDES]; /* as written, left and right */
    uint16_t steps[SIDES];
    int16_t prox[8];
    int16_t lights[8];
    uint64_t steps_ns[SIDES]; /* when those were read, 0 = not yet */
};

enum { STATE_FITS = 1 / (sizeof(struct york) <= VS_BASE_STATE_MAX) };

static const uint8_t checked[CHECKED] = {EPUCK_YORK_LEFT_SPEED, EPUCK_YORK_RIGHT_SPEED,
                                         EPUCK_YORK_SENSING, EPUCK_YORK_RING_LEDS,
                                         EPUCK_YORK_OTHER_LEDS};

static struct york *of(struct vs_base *base)
{
    return (struct york *)(void *)base->state.bytes;
}

static uint64_t now(const struct vs_base *base)
{
    return base->bus.now_ns(base->bus.context);
}

/* This firmware's limit is that of its registers. */
static const struct vs_base_body epuck2 = {EPUCK_YORK_SPEED_MAX, VS_EPUCK2_STEP_NM};

static int open_york(struct vs_base *base, const struct vs_base_config *config)
{
    of(base)->is_epuck2 = config->choice[0] == 1;
    base->body = of(base)->is_epuck2 ? &epuck2 : &vs_body_epuck;
    return vs_i2c_open(&base->bus, config->device, VS_BASE_LOCK_NS, &base->fd);
}

static int put(struct vs_base *base, uint8_t number, uint16_t value, uint64_t deadline_ns)
{
    int is_epuck2 = of(base)->is_epuck2;
    int times = is_epuck2 ? 2 : 1;
    uint8_t out[EPUCK_YORK_WRITE_LEN];
    int err = VS_OK;

    epuck_york_put_write(number, value, out);
    while (times > 0 && err == VS_OK) {
        uint32_t failures = base->bus.failures;

        err = vs_i2c_insist(&base->bus, EPUCK_YORK_ADDRESS, out, sizeof out, NULL, 0, deadline_ns);
        times -= !(is_epuck2 && base->bus.failures != failures);
    }
    return err;
}

static int get(struct vs_base *base, uint8_t number, uint16_t *value, uint64_t deadline_ns)
{
    uint8_t in[EPUCK_YORK_READ_LEN];
    int err = vs_i2c_insist(&base->bus, EPUCK_YORK_ADDRESS, &number, 1, in, sizeof in,
                            deadline_ns);

    if (err == VS_OK)
        *value = epuck_get_u16(in);
    return err;
}

/* A sensor's register: -4095..4095, since flickering light may be brighter without the
 * infrared LED. What is below 0 is 0. */
static int get_raw(struct vs_base *base, int number, int16_t *raw, uint64_t deadline_ns)
{
    uint16_t value;
    int err = get(base, (uint8_t)number, &value, deadline_ns);

    if (err != VS_OK)
        return err;
    if (value > EPUCK_YORK_RAW_MAX && value < UINT16_MAX - EPUCK_YORK_RAW_MAX + 1)
        return VS_ERR_GARBLED;
    *raw = (int16_t)(value > EPUCK_YORK_RAW_MAX ? 0 : value);
    return VS_OK;
}

static int write_speed(struct vs_base *base, int side, int16_t steps_s, uint64_t deadline_ns)
{
    struct york *y = of(base);
    int err = put(base, checked[side], (uint16_t)steps_s, deadline_ns);

    y->unchecked |= (uint8_t)(1u << side);
    if (err == VS_OK)
        y->speeds[side] = steps_s;
    return err;
}

static int write_leds(struct vs_base *base, uint16_t leds, uint64_t deadline_ns)
{
    struct york *y = of(base);
    int err = put(base, EPUCK_YORK_RING_LEDS, leds & RING_MASK, deadline_ns);

    if (err == VS_OK)
        err = put(base, EPUCK_YORK_OTHER_LEDS, epuck_york_other_leds(leds), deadline_ns);
    y->unchecked |= 1u << CHECK_RING | 1u << CHECK_OTHER;
    if (err == VS_OK)
        y->leds = leds;
    return err;
}

/* What a register that is read back has to hold. */
static uint16_t wanted(const struct york *y, int which)
{
    if (which < SIDES)
        return (uint16_t)y->speeds[which];
    if (which == CHECK_RING)
        return y->leds & RING_MASK;
    return which == CHECK_OTHER ? epuck_york_other_leds(y->leds) : 1;
}

/* Reads a register back; one that does not hold what was written is to be written again.
 * The switch of the IR sensors is off again after a reset; an e-puck2 has none. */
static int check(struct vs_base *base, int which, uint64_t deadline_ns)
{
    struct york *y = of(base);
    uint16_t value = 1;
    int err = VS_OK;

    if (which != CHECK_SENSING || !y->is_epuck2)
        err = get(base, checked[which], &value, deadline_ns);
    if (err != VS_OK)
        return err;
    if (which == CHECK_RING || which == CHECK_OTHER)
        value &= RING_MASK; /* an e-puck2 answers one byte, and says it twice */
    if (value == wanted(y, which)) {
        y->unchecked &= (uint8_t)~(1u << which);
        return VS_OK;
    }
    if (which < SIDES) {
        y->speeds[which] = INT16_MIN;
    } else if (which != CHECK_SENSING) {
        y->leds = UNKNOWN_LEDS;
    } else {
        base->news = "its microcontroller was reset";
    base->resets++;
        y->failures = FAILURES_MAX;
    }
    return VS_ERR_GARBLED;
}

static int check_all(struct vs_base *base, uint64_t deadline_ns)
{
    struct york *y = of(base);
    int err = VS_OK;
    int i;

    for (i = 0; i < CHECKED && err == VS_OK; i++)
        if (y->unchecked >> i & 1)
            err = check(base, i, deadline_ns);
    return err;
}

/* 1 if a counter can be this much further than it was. */
static int is_plausible(const struct vs_base *base, uint16_t was, uint16_t is, uint64_t after_ns)
{
    int32_t grown = (uint16_t)(is - was);
    uint64_t limit = (uint64_t)base->body->max_steps_s * (after_ns / 1000000u) / 1000u;

    if (grown >= 0x8000)
        grown = 0x10000 - grown;
    return (uint64_t)grown <= limit + SPARE_STEPS;
}

/* A counter that is read while its low byte carries is wrong by 256: it is read again. */
static int get_steps(struct vs_base *base, int side, uint64_t deadline_ns)
{
    struct york *y = of(base);
    int i;

    for (i = 0; i < READS_MAX; i++) {
        uint64_t now_ns = now(base);
        uint16_t steps;
        int err = get(base, (uint8_t)(EPUCK_YORK_LEFT_STEPS + side), &steps, deadline_ns);

        if (err != VS_OK)
            return err;
        if (y->steps_ns[side] != 0 &&
            !is_plausible(base, y->steps[side], steps, now_ns - y->steps_ns[side]))
            continue;
        y->steps[side] = steps;
        y->steps_ns[side] = now_ns;
        return VS_OK;
    }
    return VS_ERR_GARBLED;
}

static int get_light(struct vs_base *base, uint64_t deadline_ns)
{
    struct york *y = of(base);
    int err = get_raw(base, EPUCK_YORK_LIGHT + y->light, &y->lights[y->light], deadline_ns);

    if (err != VS_OK)
        return err;
    if (y->is_epuck2)
        y->lights[y->light] = (int16_t)(EPUCK_YORK_RAW_MAX - y->lights[y->light]);
    y->light = (uint8_t)((y->light + 1) % 8);
    return VS_OK;
}

/* Reads on until this exchange's reading is complete. */
static int sense(struct vs_base *base, uint64_t deadline_ns)
{
    struct york *y = of(base);

    for (; y->next < READ_END; y->next++) {
        int i = y->next;
        int err;

        if (i < READ_PROX)
            err = get_steps(base, i - READ_STEPS, deadline_ns);
        else if (i < READ_LIGHT)
            err = get_raw(base, EPUCK_YORK_PROX + i - READ_PROX, &y->prox[i - READ_PROX],
                          deadline_ns);
        else
            err = get_light(base, deadline_ns);
        if (err != VS_OK)
            return err;
    }
    return VS_OK;
}

/* Wheels 0, LEDs off, IR sensors on, all light sensors read. */
static int start(struct vs_base *base, uint64_t deadline_ns)
{
    struct york *y = of(base);
    int err = write_speed(base, 0, 0, deadline_ns);
    uint64_t sensed_ns;
    int i;

    if (err == VS_OK)
        err = write_speed(base, 1, 0, deadline_ns);
    if (err == VS_OK)
        err = write_leds(base, 0, deadline_ns);
    if (err == VS_OK)
        err = put(base, EPUCK_YORK_SENSING, 1, deadline_ns);
    y->unchecked = (1u << CHECKED) - 1;
    sensed_ns = now(base) + SENSE_NS;
    if (err == VS_OK)
        err = check_all(base, deadline_ns);
    while (err == VS_OK && !y->is_epuck2 && now(base) < sensed_ns)
        err = check(base, CHECK_SENSING, deadline_ns);
    for (i = 0; i < 8 && err == VS_OK; i++)
        err = get_light(base, deadline_ns);
    return err;
}

static int recover_york(struct vs_base *base)
{
    struct york *y = of(base);
    int err;

    y->steps_ns[0] = y->steps_ns[1] = 0;
    y->light = y->next = 0;
    err = start(base, now(base) + RECOVER_NS);
    y->failures = 0;
    y->found = err == VS_OK;
    return err == VS_ERR_GARBLED || err == VS_ERR_BUSY ? VS_ERR_SILENT : err;
}

/* Writes what changes, since a speed that is being written is wrong for a moment, which it
 * is not on an e-puck2, and reads back what was written; at the beginning of an exchange one
 * register more. */
static int obey(struct vs_base *base, const struct vs_base_command *command, uint64_t deadline_ns)
{
    struct york *y = of(base);
    int err = VS_OK;

    if (y->is_epuck2 || command->left_steps_s != y->speeds[0])
        err = write_speed(base, 0, command->left_steps_s, deadline_ns);
    if (err == VS_OK && (y->is_epuck2 || command->right_steps_s != y->speeds[1]))
        err = write_speed(base, 1, command->right_steps_s, deadline_ns);
    if (err == VS_OK && command->leds != y->leds)
        err = write_leds(base, command->leds, deadline_ns);
    if (y->next == 0) {
        y->unchecked |= (uint8_t)(1u << CHECK_SENSING | 1u << y->turn);
        y->turn = (uint8_t)((y->turn + 1) % CHECKED);
    }
    return err == VS_OK ? check_all(base, deadline_ns) : err;
}

static void report(struct vs_base *base, struct vs_base_reading *reading)
{
    const struct york *y = of(base);
    int i;

    for (i = 0; i < 8; i++) {
        reading->prox[i] = y->prox[i];
        reading->light[i] = y->lights[i];
    }
    vs_base_count(base, y->steps, reading);
}

static int exchange_york(struct vs_base *base, const struct vs_base_command *command,
                         struct vs_base_reading *reading)
{
    struct york *y = of(base);
    uint64_t deadline_ns = now(base) + VS_BASE_EXCHANGE_NS;
    int err;

    if (!y->found)
        return VS_ERR_SILENT;
    err = obey(base, command, deadline_ns);
    if (err == VS_OK)
        err = sense(base, deadline_ns);
    if (err == VS_OK) {
        report(base, reading);
        y->next = 0;
        y->failures = 0;
    } else if (err == VS_ERR_GARBLED || err == VS_ERR_SILENT) {
        y->failures++;
        err = y->failures < FAILURES_MAX ? VS_ERR_BUSY : err;
    }
    y->found = err == VS_OK || err == VS_ERR_BUSY;
    return err;
}

/* The firmware has no clean end: at rest, LEDs and IR sensors off is how its next host
 * finds it. */
static int close_york(struct vs_base *base)
{
    static const struct vs_base_command off;
    uint64_t deadline_ns = now(base) + VS_BASE_EXCHANGE_NS;
    int err;

    if (!of(base)->found)
        return VS_ERR_SILENT;
    err = obey(base, &off, deadline_ns);
    if (err == VS_OK)
        err = put(base, EPUCK_YORK_SENSING, 0, deadline_ns);
    if (err == VS_ERR_BUSY)
        return err;
    of(base)->found = 0;
    return err;
}

static const char *const models[] = {"epuck", "epuck2", NULL};
static const struct vs_base_choice choices[] = {{"model", models}, {NULL, NULL}};

const struct vs_base_ops vs_base_york = {
    "york",
    "york:BUS  e-puck with York's Pi-puck firmware on an I2C bus\n"
    "    model=epuck            firmware pi-puck-e-puck1 (default)\n"
    "    model=epuck2           branch pi-puck_proto-epuck1 of the e-puck2's",
    "/dev/i2c-12",
    1,
    choices,
    open_york,
    recover_york,
    exchange_york,
    close_york,
};
