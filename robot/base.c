/* SPDX-License-Identifier: MIT */
#include "base.h"

#include <string.h>

#include "base_config.h"
#include "../c_src/vs_i2c_posix.h"

/* A daemon for the oldest boards has no room for them. */
#ifdef VSENSED_DRIVERS
#define DRIVERS(LINE) LINE(exec) LINE(wifi)
#else
#define DRIVERS(LINE)
#endif

/* Every kind of base, in the order in which help names them. */
#define BASES(LINE) \
    LINE(argos)     \
    LINE(asercom)   \
    LINE(gctronic)  \
    LINE(york)      \
    DRIVERS(LINE)

#define DECLARE(name) extern const struct vs_base_ops vs_base_##name;
#define POINT_TO(name) &vs_base_##name,

BASES(DECLARE)
const struct vs_base_ops *const vs_bases[] = {BASES(POINT_TO) NULL};

/* Source: epuck.md section 6: 1000 steps per turn of a 41 mm wheel. The e-puck2's limit:
 * e-puck2_main-processor 517ef07 src/motors.h:7. */
const struct vs_base_body vs_body_epuck = {1000, VS_EPUCK_STEP_NM};
const struct vs_base_body vs_body_epuck2 = {1100, VS_EPUCK2_STEP_NM};

/* The bus of a board: the base's own, that of the board before it, or one of its own. A
 * socket cannot be shared: each board's process needs its own. */
static int open_board(struct vs_base *base, const struct vs_base_config *config, int board)
{
    struct vs_boards *boards = &base->boards;
    const char *path = config->board[board];
    int shares = !vs_i2c_is_socket(path);
    int other;

    if (path[0] == '\0')
        return VS_OK;
    boards->reading.there |= (uint8_t)(1u << board);
    if (shares && config->ops->on_i2c && strcmp(path, config->device) == 0) {
        boards->bus[board] = base->bus;
        return VS_OK;
    }
    for (other = 0; shares && other < board; other++) {
        if (strcmp(path, config->board[other]) == 0) {
            boards->bus[board] = boards->bus[other];
            return VS_OK;
        }
    }
    return vs_i2c_open(&boards->bus[board], path, VS_BASE_LOCK_NS, &boards->fd[board]);
}

int vs_base_open(struct vs_base *base, const struct vs_base_config *config)
{
    int board;
    int err;

    memset(base, 0, sizeof *base);
    base->ops = config->ops;
    base->boards.reading.rab_bytes = config->rab_bytes;
    base->boards.reading.rab_k_cm = config->rab_k_cm;
    base->boards.rab_power = config->rab_power;
    base->news = config->device;
    err = config->ops->open(base, config);
    if (err == VS_OK && config->reset[0] != '\0') {
        base->news = "the reset GPIO";
        err = vs_reset_open(&base->reset, config->reset);
    }
    for (board = 0; board < VS_BOARDS && err == VS_OK; board++) {
        base->news = config->board[board];
        err = open_board(base, config, board);
    }
    if (err == VS_OK)
        base->news = NULL;
    return err;
}

/* Only a base on a bus has a GPIO for it. */
static int recover_or_reset(struct vs_base *base)
{
    int err;

    if (vs_reset_lasts(&base->reset, base->bus.now_ns(base->bus.context)))
        return VS_ERR_BUSY;
    err = base->ops->recover(base);
    if (err == VS_OK)
        base->reset.begun_ns = 0; /* it was not in vain, and the next one need not wait */
    if (err != VS_ERR_SILENT ||
        !vs_reset_begin(&base->reset, base->bus.now_ns(base->bus.context)))
        return err;
    base->news = "its microcontroller does not answer and is being reset";
    base->resets++;
    return VS_ERR_BUSY;
}

int vs_base_recover(struct vs_base *base)
{
    base->counting = 0;
    return base->reset.kind == 0 ? base->ops->recover(base) : recover_or_reset(base);
}

int vs_base_exchange(struct vs_base *base, const struct vs_base_command *command,
                     struct vs_base_reading *reading)
{
    struct vs_base_command limited = *command;
    int err;

    limited.left_steps_s = vs_base_clamp(command->left_steps_s, base->body->max_steps_s);
    limited.right_steps_s = vs_base_clamp(command->right_steps_s, base->body->max_steps_s);
    limited.leds &= VS_BASE_LEDS;
    err = base->ops->exchange(base, &limited, reading);
    if (err != VS_OK)
        return err;
    reading->step_nm = base->body->step_nm;
    reading->max_steps_s = base->body->max_steps_s;
    return VS_OK;
}

void vs_base_see(const int16_t prox[8], const int16_t light[8], int16_t most,
                 struct vs_base_reading *reading)
{
    size_t i;

    for (i = 0; i < 8; i++) {
        reading->prox[i] = prox[i] < 0 ? 0 : prox[i];
        reading->light[i] = (int16_t)(most - light[i]);
    }
}

void vs_base_feel(const int16_t acceleration[3], const int16_t *microphones, int count,
                  struct vs_base_reading *reading)
{
    int i;

    for (i = 0; acceleration != NULL && i < 3; i++)
        reading->acceleration[i] = acceleration[i];
    for (i = 0; i < count; i++)
        reading->microphones[i] = microphones[i];
    reading->microphone_count = (uint8_t)count;
}

void vs_base_count(struct vs_base *base, const uint16_t counters[2],
                   struct vs_base_reading *reading)
{
    int i;

    for (i = 0; i < 2; i++) {
        int32_t grown = (uint16_t)(counters[i] - base->counters[i]);

        if (base->counting)
            base->steps[i] += grown < 0x8000 ? grown : grown - 0x10000;
        base->counters[i] = counters[i];
        reading->steps[i] = base->steps[i];
    }
    base->counting = 1;
    reading->has_steps = 1;
}
