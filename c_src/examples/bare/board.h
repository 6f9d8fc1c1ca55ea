/* SPDX-License-Identifier: MIT */
/* board.h - the little that is needed of a board: two UARTs and a clock. */
#ifndef BOARD_H
#define BOARD_H

#include <stddef.h>
#include <stdint.h>

enum board_uart { UART_HOST = 0, UART_MOTORS = 1 };

void board_init(void);

/* [ns] since the start; it counts in microseconds. To be asked once an hour at least. */
uint64_t board_now_ns(void);

/* Waits for a byte, or for the next millisecond. */
void board_wait(void);

/* The next received byte, or -1. What nobody reads in time is lost. */
int board_read(enum board_uart uart);

/* Has all of it sent, in its turn; never waits. -1: there is no room for all, so nothing is. */
int board_write(enum board_uart uart, const uint8_t *bytes, size_t len);

#endif
