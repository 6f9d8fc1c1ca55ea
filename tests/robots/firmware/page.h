/* A microcontroller as a process: what its test reads and writes, and what each firmware brings. */
#ifndef PAGE_H
#define PAGE_H

#include <stdint.h>

/** Memory that the test maps, too; `PAGE` of real.py has the same layout. */
struct page {
    int64_t late_ns; /**< The longest that it was held up; the test sets it to 0. */
    int64_t stepped_ns; /**< Raw monotonic clock at a motor's newest step. */
    int32_t left_steps, right_steps; /**< Of the firmware's own motor library, since its reset. */
    int32_t leds; /**< Those on: bits 0-7 ring, 8 body, 9 front. */
    int32_t resets; /**< How often it has begun. */
    int32_t radio_sent, radio_inits; /**< Datum + 1 that it last sent, how often it was set up. */
    int32_t bus; /**< Descriptor of who is on the bus, 0: nobody; a reset does not change that. */
    int32_t reset; /**< The test has it reset now. */
    int32_t battery_good; /**< Level of the pin. */
    int32_t proximity[8], light[8]; /**< What the converter gives: ambient - lit, ambient. */
};
extern struct page *page;

enum { TICK_NS = 100000, CYCLES = 1475 /**< Of the chip in a tick, 14.7456 MHz. */ };

/** One byte of the line, within a millisecond; 0: none came. */
int uart_get(char *c);
void uart_put(const char *bytes, int length);
/** What came before the UART was set up is lost. */
void uart_flush(void);

/** The descriptor of its serial line's end, or of its bus' listening socket. */
extern int line;

/** Of each firmware: its interrupts of one tick, and what goes into the page. */
void chip_tick(void);
void chip_shows(struct page *shown);

#endif
