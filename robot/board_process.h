/* SPDX-License-Identifier: MIT */
/*
 * board_process.h - a board beside the base, in a process of its own. A bus that hangs keeps
 * whoever asks it: drivers wait for a second or longer, in a state in which no signal is heard.
 * Here that costs the board's own readings. The process answers each request once; the worker's
 * end is board_link.h.
 */
#ifndef VS_BOARD_PROCESS_H
#define VS_BOARD_PROCESS_H

#include "base_boards.h"

/* It and requests travel between two processes of the same binary, as they are. */
struct vs_board_answer {
    const char *news; /* a line for the log, NULL = none: a phrase of the program */
    struct vs_board_reading reading;
};

/* Serves requests on socket (SOCK_SEQPACKET) until its other end is closed: whoever asked has
 * ended, or is gone. RGB LEDs are dark then. */
void vs_board_process(int socket, struct vs_boards *boards, int board);

#endif
