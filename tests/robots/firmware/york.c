/* What York's firmware for Pi-pucks needs below it: timers, converter, and the I2C module as slave.
 *
 * A byte on the bus takes a tick, so the program runs between the bytes of a register, as there. */
#define _GNU_SOURCE
#include <errno.h>
#include <stdint.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <xc.h>

#include "ir_sensors.h"
#include "leds.h"
#include "motors.h"
#include "leds_on.h"
#include "page.h"

enum { HEADER = 6, REPLY = 5, FREE = -1 };

void _SI2CInterrupt(void);
void _T1Interrupt(void);
void _T4Interrupt(void);
void _T5Interrupt(void);

static const int PRESCALE[] = {1, 8, 64, 256};

static unsigned char sent[2], reply[REPLY + 64];
static int fetched;

/* I2CTRN of the header: each byte that the firmware puts there. */
unsigned char *i2c_next(void)
{
    static unsigned char lost;
    return fetched < (int)sizeof sent ? &sent[fetched++] : &lost;
}

static void run(int on, int enabled, int prescale, int period, int *cycles, void (*interrupt)(void))
{
    if (!on || !enabled || period == 0) {
        *cycles = 0;
        return;
    }
    int length = (period + 1) * PRESCALE[prescale & 3]; /* the match is a count of its own */
    for (*cycles += CYCLES; *cycles >= length; *cycles -= length) {
        interrupt();
    }
}

static void interrupt_with(int is_read, int is_data, int byte)
{
    I2CSTATbits.R_W = is_read;
    I2CSTATbits.D_A = is_data;
    I2CRCV = byte;
    _SI2CInterrupt();
}

/* Lets one byte of the newest transaction pass. */
static void bus(void)
{
    static unsigned char request[64];
    static int length, at = FREE, got;
    int host = page->bus;
    if (host == 0) {
        host = accept4(line, NULL, NULL, SOCK_NONBLOCK);
        if (host > 0 && write(host, "\1", 1) == 1)
            page->bus = host;
        return;
    }
    if (at == FREE) {
        length = (int)recv(host, request, sizeof request, 0);
        if (length == 0 || (length < 0 && errno != EAGAIN && errno != EINTR)) {
            close(host);
            page->bus = 0;
        } else if (length >= HEADER) {
            memset(reply, 0, sizeof reply);
            memcpy(reply, request, 4);
            reply[4] = request[4] != I2CADD;
            at = HEADER;
            got = -1;
        }
        return;
    }
    int wanted = request[5];
    if (reply[4] == 0 && at == HEADER && length > HEADER)
        interrupt_with(0, 0, I2CADD << 1);
    if (reply[4] == 0 && at < length) {
        interrupt_with(0, 1, request[at++]);
        return;
    }
    if (reply[4] == 0 && got < wanted && wanted > 0) {
        if (got < 0) { /* it puts both bytes of its register at once */
            fetched = 0;
            interrupt_with(1, 0, I2CADD << 1 | 1);
        } else {
            reply[REPLY + got] = got < fetched ? sent[got] : 0xff;
        }
        got++;
        return;
    }
    if (send(host, reply, (size_t)(REPLY + (reply[4] == 0 ? wanted : 0)), MSG_NOSIGNAL) < 0) {
        close(host);
        page->bus = 0;
    }
    at = FREE;
}

unsigned int adc_read(unsigned int channel)
{
    int sensor = (int)channel - IR0;
    int lit = (int[]){PULSE_IR0, PULSE_IR1, PULSE_IR2, PULSE_IR3}[sensor & 3];
    return (unsigned)(page->light[sensor] - (lit ? page->proximity[sensor] : 0));
}

void adc_init(void) {}
void uart2_init(void) {}

void delay_ms(int ms)
{
    struct timespec end;
    clock_gettime(CLOCK_MONOTONIC, &end);
    end.tv_nsec += ms * 1000000;
    end.tv_sec += end.tv_nsec / 1000000000;
    end.tv_nsec %= 1000000000;
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &end, NULL) != 0)
        ; /* interrupts come in between */
}

void chip_tick(void)
{
    static int cycles[3];
    run(T1CONbits.TON, IEC0bits.T1IE, T1CONbits.TCKPS, PR1, &cycles[0], _T1Interrupt);
    run(T4CONbits.TON, IEC1bits.T4IE, T4CONbits.TCKPS, PR4, &cycles[1], _T4Interrupt);
    run(T5CONbits.TON, IEC1bits.T5IE, T5CONbits.TCKPS, PR5, &cycles[2], _T5Interrupt);
    if (IEC0bits.SI2CIE)
        bus();
}

void chip_shows(struct page *shown)
{
    shown->left_steps = (int16_t)motors_get_steps_left();
    shown->right_steps = (int16_t)motors_get_steps_right();
    shown->leds = leds_on();
}
