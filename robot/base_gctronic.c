/* SPDX-License-Identifier: MIT */
/*
 * base_gctronic.c - an e-puck2 with GCtronic's gumstix firmware over I2C
 * (epuck_gctronic.h). No answer says whether a packet was applied: one with a bad
 * checksum is not, nor is the one after an error on the bus. So a packet is sent once
 * more after every error, and once more when it is to stop the wheels.
 */
#include "base_config.h"

#include "../c_src/epuck_gctronic.h"
#include "../c_src/vs_i2c_posix.h"

#define RECOVER_NS 90000000u /* [ns] longest step of recovery */

enum { TRIES = 3 };

struct gctronic {
    uint8_t found;
    uint8_t failures; /* in a row */
    uint8_t wanted;   /* packets in a row that have to go well before the newest one counts */
    int16_t left_steps_s; /* of the newest packet */
    int16_t right_steps_s;
};

enum { STATE_FITS = 1 / (sizeof(struct gctronic) <= VS_BASE_STATE_MAX) };

static struct gctronic *of(struct vs_base *base)
{
    return (struct gctronic *)(void *)base->state.bytes;
}

static int open_gctronic(struct vs_base *base, const struct vs_base_config *config)
{
    base->body = &vs_body_epuck2;
    return vs_i2c_open(&base->bus, config->device, VS_BASE_LOCK_NS, &base->fd);
}

/* One packet and its answer. Whatever goes wrong: the next good packet may be dropped. */
static int go_round(struct vs_base *base, const uint8_t packet[EPUCK_GCTRONIC_ACTUATOR_LEN],
                    struct epuck_gctronic_sensors *sensors)
{
    struct gctronic *g = of(base);
    uint8_t answer[EPUCK_GCTRONIC_SENSOR_LEN];
    int err = base->bus.transfer(base->bus.context, EPUCK_GCTRONIC_ADDRESS, packet,
                                 EPUCK_GCTRONIC_ACTUATOR_LEN, answer, sizeof answer);

    if (err == VS_OK && epuck_gctronic_get_sensors(answer, sensors) != 0)
        err = VS_ERR_GARBLED;
    if (err == VS_OK) {
        g->failures = 0;
        g->wanted--;
    } else {
        g->failures++;
        g->wanted = 2;
    }
    return err;
}

/* Of full brightness, at least 1 if it shines at all. */
static uint8_t percent(uint8_t brightness)
{
    return (uint8_t)((brightness * EPUCK_GCTRONIC_BRIGHTNESS_MAX + UINT8_MAX - 1) / UINT8_MAX);
}

/* Sends until the packet counts (VS_OK), three in a row go wrong, or there is no time for
 * more (VS_ERR_BUSY). */
static int insist(struct vs_base *base, const struct vs_base_command *command,
                  struct epuck_gctronic_sensors *sensors, uint64_t deadline_ns)
{
    struct gctronic *g = of(base);
    struct epuck_gctronic_actuators actuators = {command->left_steps_s, command->right_steps_s,
                                                 (uint8_t)(command->leds & 0xFF), {{0}}};
    uint8_t packet[EPUCK_GCTRONIC_ACTUATOR_LEN];
    int i;

    for (i = 0; i < 3 * VS_BASE_RGB_LEDS; i++)
        actuators.rgb[i / 3][i % 3] = percent(command->rgb[i / 3][i % 3]);
    epuck_gctronic_put_actuators(&actuators, packet);
    while (g->wanted > 0) {
        int err;

        if (!vs_i2c_has_time(&base->bus, deadline_ns))
            return VS_ERR_BUSY;
        err = go_round(base, packet, sensors);
        if (g->failures >= TRIES || err == VS_ERR_IO || err == VS_ERR_HANGUP)
            return err;
    }
    return VS_OK;
}

/* 1 if the command stops a wheel that turned. */
static int stops(const struct gctronic *g, const struct vs_base_command *command)
{
    return (command->left_steps_s == 0 && g->left_steps_s != 0) ||
           (command->right_steps_s == 0 && g->right_steps_s != 0);
}

static int recover_gctronic(struct vs_base *base)
{
    static const struct vs_base_command off;
    struct gctronic *g = of(base);
    uint64_t deadline_ns = base->bus.now_ns(base->bus.context) + RECOVER_NS;
    struct epuck_gctronic_sensors sensors;
    int err;

    g->failures = 0;
    g->wanted = 2;
    err = insist(base, &off, &sensors, deadline_ns);
    g->found = err == VS_OK;
    g->left_steps_s = g->right_steps_s = 0;
    return err == VS_ERR_BUSY || err == VS_ERR_GARBLED ? VS_ERR_SILENT : err;
}

static void report(struct vs_base *base, const struct epuck_gctronic_sensors *sensors,
                   struct vs_base_reading *reading)
{
    vs_base_see(sensors->prox, sensors->light, EPUCK_GCTRONIC_RAW_MAX, reading);
    vs_base_feel(NULL, sensors->microphones, 4, reading);
    reading->rgb_leds = VS_BASE_RGB_LEDS;
    vs_base_count(base, sensors->steps, reading);
}

static int exchange_gctronic(struct vs_base *base, const struct vs_base_command *command,
                             struct vs_base_reading *reading)
{
    struct gctronic *g = of(base);
    uint64_t deadline_ns = base->bus.now_ns(base->bus.context) + VS_BASE_EXCHANGE_NS;
    struct epuck_gctronic_sensors sensors;
    int err;

    if (!g->found)
        return VS_ERR_SILENT;
    if (g->wanted == 0)
        g->wanted = 1;
    if (stops(g, command))
        g->wanted = 2;
    g->left_steps_s = command->left_steps_s;
    g->right_steps_s = command->right_steps_s;
    err = insist(base, command, &sensors, deadline_ns);
    g->found = err == VS_OK || err == VS_ERR_BUSY;
    if (err == VS_OK)
        report(base, &sensors, reading);
    return err;
}

/* The firmware has no clean end: at rest, LEDs off is how its next host finds it. */
static int close_gctronic(struct vs_base *base)
{
    static const struct vs_base_command off;
    struct vs_base_reading scrap;

    return exchange_gctronic(base, &off, &scrap);
}

static const struct vs_base_choice choices[] = {{NULL, NULL}};

const struct vs_base_ops vs_base_gctronic = {
    "gctronic",
    "gctronic:BUS  e-puck2 with GCtronic's gumstix firmware on an I2C bus, selector 10",
    "/dev/i2c-12",
    1,
    choices,
    open_gctronic,
    recover_gctronic,
    exchange_gctronic,
    close_gctronic,
};
