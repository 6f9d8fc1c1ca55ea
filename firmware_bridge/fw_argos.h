/* SPDX-License-Identifier: MIT */
/*
 * fw_argos.h - the microcontroller's end of IRIDIA's fixed-struct UART protocol
 * (frames: epuck_argos.h), as freestanding C: no operating system, no malloc,
 * no clock. The lab's emulated robots run it behind pseudo terminals.
 *
 * Life of a PIC: it waits for any byte, reads 4 bytes of configuration, then
 * for ever sends 72 bytes and reads 12. It applies a frame when its last byte
 * has come and answers at once. There is no time-out anywhere: a host that dies
 * in mid-frame leaves it waiting, wheels turning. Quirks that are kept:
 * - motors are written only when a frame's speed differs from the last frame's;
 * - LEDs are toggled by the difference between two frames, never set;
 * - 'R' applies the frame, puts the ring LEDs out behind the toggling's back
 *   and goes back to waiting for the wake-up byte;
 * - a frame that enables IRcom (ours never does, a misaligned one may) is answered
 *   only after an infrared word was sent;
 * - bytes that come while it transmits wait in a ring of 64 without an overflow
 *   test: one byte too many and all 64 are gone.
 *
 * How to drive it, from a loop that owns a clock:
 *     n = read(pty); fw_argos_receive(fw, buf, n, now_us);
 *     while (fw_argos_advance(fw, now_us)) { ... fw->outputs, fw->applied_us }
 *     n = fw_argos_transmit(fw, buf, sizeof buf, now_us); write(pty, buf, n);
 *     sleep until fw_argos_due_us(fw), the next input or the physics' tick.
 * now_us must never go back. One struct is one microcontroller; it outlives the
 * daemons that come and go at the other end.
 */
#ifndef FW_ARGOS_H
#define FW_ARGOS_H

#include <stddef.h>
#include <stdint.h>

#include "epuck_argos.h"
#include "fw_line.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    FW_ARGOS_RING = 64,        /* [bytes] receive buffer of the UART interrupt */
    FW_ARGOS_IRCOM_US = 60000  /* [us] estimate: 12 bits at libIrcom's 30 bytes/s, and
                                  a delay loop of about as much */
};

enum fw_argos_state {
    FW_ARGOS_WAKE = 0,   /* waits for any byte */
    FW_ARGOS_CONFIG = 1, /* reads 4 bytes */
    FW_ARGOS_FRAME = 2   /* reads 12 bytes */
};

/* What the motors and LEDs do now. */
struct fw_argos_outputs {
    int16_t left_steps_s;  /* [steps/s] -1000..1000, clamped as the library does */
    int16_t right_steps_s; /* [steps/s] -1000..1000 */
    uint16_t leds;         /* lit ones: bits 0-7 ring, 8 body, 9 front */
};

struct fw_argos {
    /* the owner writes */
    struct epuck_argos_sensors inputs; /* what the next sensor frame says */
    /* called, unless NULL, when a sensor frame is composed: fills *inputs with
     * what the robot measures at time_us; context is the owner's */
    void (*sample)(void *context, uint64_t time_us,
                   struct epuck_argos_sensors *inputs);
    void *context;
    /* the owner reads */
    struct fw_argos_outputs outputs;
    uint64_t applied_us; /* when the newest frame was applied */
    uint32_t frames;     /* actuator frames applied since power on */
    uint32_t overlapped; /* bytes that came while it transmitted: a host that
                            keeps the protocol's rule never makes one */
    uint32_t overflowed; /* bytes lost in the receive ring */
    uint32_t unsent;     /* bytes of answers lost on a full line: nobody took the others */
    /* its own */
    enum fw_argos_state state;
    struct epuck_argos_actuators old;
    uint8_t frame[EPUCK_ARGOS_ACTUATOR_LEN];
    uint32_t got; /* bytes of config or frame so far */
    uint8_t ring[FW_ARGOS_RING];
    uint32_t ring_read;
    uint32_t ring_write;
    uint64_t lived_ns;      /* everything up to here has happened */
    uint64_t busy_until_ns; /* 0: it reads its ring */
    uint8_t sending;        /* busy transmitting, else with IRcom */
    struct fw_line rx;
    struct fw_line tx;
};

/* Power on: motors and LEDs off, no hook, waits for the wake-up byte. */
void fw_argos_init(struct fw_argos *fw);

/* Puts bytes from the host on the line at now_us.
 * Returns how many fit (the line holds 256); offer the rest again later. */
size_t fw_argos_receive(struct fw_argos *fw, const uint8_t *buf, size_t len,
                        uint64_t now_us);

/* Lives on to now_us, or to the moment when a frame has been applied.
 * Returns 1 if one was (outputs, applied_us are its; call again), 0 if it lived
 * to now_us. */
int fw_argos_advance(struct fw_argos *fw, uint64_t now_us);

/* Takes the bytes that reached the host by now_us. Returns how many. */
size_t fw_argos_transmit(struct fw_argos *fw, uint8_t *buf, size_t cap,
                         uint64_t now_us);

/* When all that is now on one of the two lines has arrived, or the program is
 * no longer busy: polling earlier than that gains nothing. UINT64_MAX if
 * nothing is under way. */
uint64_t fw_argos_due_us(const struct fw_argos *fw);

#ifdef __cplusplus
}
#endif

#endif
