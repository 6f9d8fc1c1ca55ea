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
 *   and goes back to waiting for the wake-up byte, for which it looks between two
 *   steps of a light that runs around only;
 * - the configuration may switch on its own range-and-bearing, and only another one
 *   switches that off again: a frame that follows a reset is taken for one;
 * - a frame that enables IRcom (ours never does, a misaligned one may) is answered
 *   only after an infrared word was sent;
 * - bytes that come while it transmits wait in a ring of 64 without an overflow
 *   test: one byte too many and all 64 are gone.
 *
 * How to drive it, from a loop that owns a clock:
 *     n = read(pty); fw_argos_receive(fw, buf, n, now_us);
 *     while (fw_argos_advance(fw, now_us)) { ... fw->body.outputs, .applied_us }
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
#include "fw_body.h"
#include "fw_uart.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    FW_ARGOS_IRCOM_US = 60000, /* [us] estimate: 12 bits at libIrcom's 30 bytes/s, and
                                  a delay loop of about as much */
    FW_ARGOS_BLINK_US = 60000, /* [us] estimate: 100000 rounds of a delay loop at 14.7 MIPS
                                  pass between two looks for the wake-up byte */
    FW_ARGOS_BATTERY_LOW_MV = 3400
};

enum fw_argos_state {
    FW_ARGOS_WAKE = 0,   /* waits for any byte */
    FW_ARGOS_CONFIG = 1, /* reads 4 bytes */
    FW_ARGOS_FRAME = 2   /* reads 12 bytes */
};

struct fw_argos {
    struct fw_body body;
    struct fw_uart uart; /* its counters are the owner's to read, its faults to write */
    uint32_t frames;     /* actuator frames applied since power on */
    enum fw_argos_state state;
    struct epuck_argos_actuators old;
    uint8_t frame[EPUCK_ARGOS_ACTUATOR_LEN];
    uint32_t got; /* bytes of config or frame so far */
    uint8_t config[EPUCK_ARGOS_CONFIG_LEN]; /* as received last, zeros after a reset */
    uint64_t waiting_us;                    /* when it began to wait for the wake-up byte */
    uint8_t rab_hears;   /* the owner writes: 1 = its own range-and-bearing, if it is on,
                            hears somebody in every frame */
};

/* Power on: motors and LEDs off, waits for the wake-up byte. */
void fw_argos_init(struct fw_argos *fw);

/* Reset at now_us: as power on, but the robot's sensors and the lines stay as they are. At
 * power on a dsPIC resets itself once more: link appears, vanishes, appears. */
void fw_argos_reset(struct fw_argos *fw, uint64_t now_us);

/* Puts bytes from the host on the line at now_us.
 * Returns how many fit (the line holds 256); offer the rest again later. */
size_t fw_argos_receive(struct fw_argos *fw, const uint8_t *buf, size_t len,
                        uint64_t now_us);

/* Lives on to now_us, or to the moment when the outputs may have changed.
 * Returns 1 then (body.outputs, body.applied_us; call again), 0 if it lived to now_us. */
int fw_argos_advance(struct fw_argos *fw, uint64_t now_us);

/* Takes the bytes that reached the host by now_us. Returns how many. */
size_t fw_argos_transmit(struct fw_argos *fw, uint8_t *buf, size_t cap,
                         uint64_t now_us);

/* When it pays to look again, UINT64_MAX if nothing is under way. */
uint64_t fw_argos_due_us(const struct fw_argos *fw);

#ifdef __cplusplus
}
#endif

#endif
