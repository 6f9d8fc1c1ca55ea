/* SPDX-License-Identifier: MIT */
/*
 * radio.h - what the board's Wi-Fi says of itself. A driver whose firmware is in trouble may take
 * seconds to answer, so a process of its own asks it once a second: the worker waits for nothing.
 */
#ifndef VS_RADIO_H
#define VS_RADIO_H

#include "../c_src/vs_body.h"

#define VS_RADIO_MS 1000           /* [ms] between two looks */
#define VS_RADIO_HEAR_NS 950000000 /* [ns] between two ears for them */
#define VS_RADIO_SILENCE 4         /* so often nothing was heard: nobody knows any more */

struct vs_radio_look { /* as the fields of struct vs_telemetry */
    uint32_t retries;
    uint16_t bit_rate;
    int8_t signal_dbm;
    uint8_t power_saving;
};

/* All zeros before vs_radio_start. */
struct vs_radio {
    int socket; /* -1: there is no radio, or no process that asks it */
    int silent; /* so often nothing was heard */
    uint64_t heard_ns;
    struct vs_radio_look look;
};

/* Starts the process on a board whose Linux knows of radios. Of these it asks the one whose address
 * packets to the host (IPv4, network order) come from. */
void vs_radio_start(struct vs_radio *radio, uint32_t host);

/* Fills in the radio's fields, what is not known as unknown, and asks now and then what the
 * process has said. */
void vs_radio_tell(struct vs_radio *radio, uint64_t now_ns, struct vs_telemetry *t);

#ifdef VSENSED_SLOW_CLOCK
/* A lab's radio: a file that looks like /proc/net/wireless. Below it may stand "rate 54000000"
 * [bit/s] and "power 1", which a board says by ioctls. */
void vs_radio_emulate(const char *file);
#endif

#endif
