/* SPDX-License-Identifier: MIT */
/* robot_bus.h - a base on an emulated I2C bus on virtual time, microcontroller and boards
 * being the firmware's own code. The bus can do everything that goes wrong. */
#ifndef ROBOT_BUS_H
#define ROBOT_BUS_H

#include <string.h>

#include "base_config.h"
#include "fw_boards.h"
#include "fw_gctronic.h"
#include "fw_imu.h"
#include "fw_york.h"
#include "robot_check.h"

#define MS 1000000u

extern const struct vs_base_ops vs_base_gctronic;
extern const struct vs_base_ops vs_base_york;

struct bus_world {
    struct fw_i2c wires;
    struct fw_gctronic gctronic;
    struct fw_york york;
    struct fw_ground ground;
    struct fw_rab rab;
    struct fw_adc adc;
    struct fw_rgb rgb;
    struct fw_imu imu;
    struct fw_body *body; /* of the microcontroller that is on the bus */
    struct vs_base base;
    struct vs_base_reading reading;
    uint64_t now_ns;
    uint64_t stuck_until_ns; /* 0: the owner ends it */
    uint32_t random;
    uint32_t fault_one_in;   /* transactions; 0 = none */
    uint32_t overhead_us;    /* of the host, per transaction */
    uint32_t transfers;
};

static inline void bus_live(struct bus_world *w)
{
    uint64_t now_us = w->now_ns / 1000;

    (void)fw_gctronic_advance(&w->gctronic, now_us);
    (void)fw_york_advance(&w->york, now_us);
    if (w->stuck_until_ns != 0 && w->now_ns >= w->stuck_until_ns) {
        w->wires.stuck = 0;
        w->stuck_until_ns = 0;
    }
}

static inline void bus_pass(struct bus_world *w, uint64_t ns)
{
    w->now_ns += ns;
    bus_live(w);
}

static inline uint64_t bus_now(void *context)
{
    return ((struct bus_world *)context)->now_ns;
}

/* Any fault of the bus, sooner or later. */
static inline void bus_fault(struct bus_world *w)
{
    struct fw_i2c_faults *faults = &w->wires.faults;

    if (w->fault_one_in == 0 || draw(&w->random, w->fault_one_in) != 0)
        return;
    switch (draw(&w->random, 4)) {
    case 0:
        faults->refuse = 1;
        break;
    case 1:
        faults->flip_write = 1;
        break;
    case 2:
        faults->flip_read = 1;
        break;
    default:
        w->wires.stuck = 1;
        w->stuck_until_ns = w->now_ns + draw(&w->random, 120) * MS;
        break;
    }
}

static inline int bus_transfer(void *context, uint8_t address, const uint8_t *out, size_t out_len,
                               uint8_t *in, size_t in_len)
{
    struct bus_world *w = context;
    enum fw_i2c_result result;

    w->transfers++;
    bus_fault(w);
    bus_pass(w, w->overhead_us * 1000u);
    result = fw_i2c_transfer(&w->wires, address, out, out_len, in, in_len, w->now_ns / 1000);
    if (result == FW_I2C_STUCK)
        bus_pass(w, VS_I2C_TIMEOUT_NS - w->overhead_us * 1000u);
    else if (w->wires.free_us * 1000 > w->now_ns)
        bus_pass(w, w->wires.free_us * 1000 - w->now_ns);
    return result == FW_I2C_ACK ? VS_OK : VS_ERR_SILENT;
}

/* A base as vs_base_open leaves it, but on our wires. */
static inline void bus_begin(struct bus_world *w, const struct vs_base_ops *ops, uint32_t seed)
{
    struct vs_base_config config = {ops, "/nowhere", {"", ""}, 2, 115, 0.0867438559f, {0, 0}, ""};
    int i;

    memset(w, 0, sizeof *w);
    w->random = seed * 2654435761u + 1u;
    w->now_ns = 1000 * MS;
    w->overhead_us = 60;
    fw_i2c_init(&w->wires);
    fw_gctronic_init(&w->gctronic);
    fw_york_init(&w->york);
    fw_ground_init(&w->ground);
    fw_rab_init(&w->rab);
    fw_adc_init(&w->adc);
    fw_rgb_init(&w->rgb);
    fw_imu_init(&w->imu, EPUCK_IMU_MPU9250);
    w->body = ops == &vs_base_york ? &w->york.body : &w->gctronic.body;
    CHECK(fw_i2c_add(&w->wires, ops == &vs_base_york ? &w->york.device : &w->gctronic.device) == 0);
    CHECK(fw_i2c_add(&w->wires, &w->ground.device) == 0);
    CHECK(fw_i2c_add(&w->wires, &w->rab.device) == 0);
    CHECK(fw_i2c_add(&w->wires, &w->adc.device) == 0);
    CHECK(fw_i2c_add(&w->wires, &w->rgb.device) == 0);
    CHECK(fw_i2c_add(&w->wires, &w->imu.device) == 0);
    CHECK(vs_base_open(&w->base, &config) == VS_ERR_IO);
    w->base.news = NULL;
    w->base.bus.context = w;
    w->base.bus.now_ns = bus_now;
    w->base.bus.transfer = bus_transfer;
    for (i = 0; i < 8; i++) {
        w->body->inputs.prox[i] = (int16_t)(100 * i + 7);
        w->body->inputs.light[i] = (int16_t)(4000 - 300 * i);
    }
}

/* Puts a board on the base's bus. */
static inline void bus_board(struct bus_world *w, int board, uint8_t rab_bytes)
{
    w->base.boards.bus[board] = w->base.bus;
    w->base.boards.reading.there |= (uint8_t)(1u << board);
    w->base.boards.reading.rab_bytes = rab_bytes;
}

static inline int bus_at_rest(const struct bus_world *w)
{
    return w->body->outputs.left_steps_s == 0 && w->body->outputs.right_steps_s == 0;
}

/* One step of recovery, which has its limit. */
static inline int bus_recover(struct bus_world *w)
{
    uint64_t began_ns = w->now_ns;
    int err = vs_base_recover(&w->base);

    CHECK(w->now_ns - began_ns <= 100 * MS);
    return err;
}

/* One exchange, which has its limit. */
static inline int bus_exchange(struct bus_world *w, int16_t left, int16_t right, uint16_t leds)
{
    struct vs_base_command command = {left, right, leds, {0, {0}}, {{0}}};
    uint64_t began_ns = w->now_ns;
    int err = vs_base_exchange(&w->base, &command, &w->reading);

    CHECK(w->now_ns - began_ns <= 30 * MS);
    return err;
}

#endif
