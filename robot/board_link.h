/* SPDX-License-Identifier: MIT */
/*
 * board_link.h - the worker's end of the boards' processes: starts one per board, asks it with
 * each request to the guard, takes what it measured. It is never waited for: while one hangs its
 * readings are unknown, and all else goes on.
 */
#ifndef VS_BOARD_LINK_H
#define VS_BOARD_LINK_H

#include <poll.h>

#include "base.h"
#include "board_process.h"
#include "calibration.h"

#define VS_BOARD_HANGS_NS 300000000u  /* [ns] without an answer: the longest read takes 90 ms */
#define VS_BOARD_KILL_NS UINT64_C(10000000000) /* [ns] then it is killed */
#define VS_BOARD_AGAIN_NS 1000000000u /* [ns] from one's end to the next one's start */

struct vs_board_link {
    long pid;           /* 0: none */
    int socket;         /* -1: none */
    uint8_t waiting;    /* for an answer */
    uint8_t hangs;      /* it was told so */
    uint64_t asked_ns;
    uint64_t again_ns;  /* without a process: when to start one */
};

struct vs_board_links {
    struct vs_base *base;
    struct vs_board_reading *reading; /* of all boards, for the controller */
    const struct vs_calibration *calibration; /* of the ground board; NULL: none */
    const uint8_t *raw; /* 1: it does not count; where there is one */
    int end; /* 0: the robot has no boards, else VS_BOARDS */
    uint8_t rgb[EPUCK_RGB_LEDS][3]; /* what the RGB LEDs were asked for last */
    struct vs_board_link link[VS_BOARDS];
};

/* No process yet. reading becomes what is known before anything is measured. */
void vs_board_links_init(struct vs_board_links *links, struct vs_base *base,
                         struct vs_board_reading *reading);

/* Starts what is to be started, takes what is there, and looks what hangs. Returns a line that
 * is worth telling, then it is to be called again; NULL at the end. */
const char *vs_board_links_serve(struct vs_board_links *links, uint64_t now_ns);

/* Asks every board that does not owe an answer, and RGB LEDs only for another colour. */
void vs_board_links_ask(struct vs_board_links *links, const struct vs_base_command *command,
                        uint64_t now_ns);

/* Fills in which answers have to be waited for, at most VS_BOARDS. Returns how many fds they are. */
int vs_board_links_poll(const struct vs_board_links *links, struct pollfd *fds);

#endif
