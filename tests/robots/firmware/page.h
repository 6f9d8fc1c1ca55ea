/* A microcontroller as a process: what its test reads and writes, and its serial line. */
#ifndef PAGE_H
#define PAGE_H

#include <stdint.h>

#include "motor_led/e_epuck_ports.h"

/** Memory that the test maps, too; `PAGE` of real_firmware.py has the same layout. */
struct page {
    int64_t stepped_ns; /**< Raw monotonic clock at a motor's newest step. */
    int32_t left_steps, right_steps; /**< Of the firmware's own motor library, since its reset. */
    int32_t ring; /**< LEDs on: bits 0-7 ring, 8 body, 9 front. */
    int32_t resets; /**< How often it has begun. */
    int32_t radio_sent, radio_inits; /**< Datum + 1 that it last sent, how often it was set up. */
    int32_t reset; /**< The test has it reset now. */
    int32_t battery_good; /**< Level of the pin. */
    int32_t proximity[8], light[8]; /**< What the converter gives. */
};
extern struct page *page;

/** One byte of the line, within a millisecond; 0: none came. */
int uart_get(char *c);
/** What came before the UART was set up is lost. */
void uart_flush(void);
void uart_put(const char *bytes, int length);

/** LEDs that are on, as in the page. */
int ring(void);

#endif
