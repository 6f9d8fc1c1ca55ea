/* SPDX-License-Identifier: MIT */
/*
 * robot.h - what a robot does that has nothing but a microcontroller: it greets the host, greets
 * it again when that was silent, lets its wheels turn only while fresh states come, and tells
 * what it did. Sans-I/O as vs_session.h: both examples feed it with bytes and times.
 */
#ifndef ROBOT_H
#define ROBOT_H

#include "vs_session.h"

#define ROBOT_SILENCE_NS 350000000u   /* [ns] after the last fresh state: wheels 0 */
#define ROBOT_RESUME 3                /* fresh states in a row that end such a silence */
#define ROBOT_PATIENCE_NS 2000000000u /* [ns] without a packet: the host is gone */
#define ROBOT_AGAIN_NS 1000000000u    /* [ns] between two greetings that nobody answers */
#define ROBOT_TELL_NS 50000000u       /* [ns] between two packets to the host */

struct robot {
    struct vs_session session;
    struct vs_telemetry telemetry; /* what the controller shows and actuates goes into it */
    uint64_t greeted_ns;           /* when the newest greeting was begun */
    uint64_t heard_ns;             /* when the host's newest packet came */
    uint64_t told_ns;
    uint64_t fresh_ns;             /* newest fresh state, 0 = none in this session */
    uint8_t fresh;                 /* in a row, up to ROBOT_RESUME */
    uint8_t stepped;               /* the controller has made its step for the newest state */
    int16_t max_steps_s;           /* the experiment's speed limit vs:v_max */
    int16_t left_steps_s;          /* what the controller wants */
    int16_t right_steps_s;
};

/* Errors: those of vs_session_init. */
int robot_init(struct robot *r, const struct vs_session_config *config);

/* A connection, or a byte stream's new beginning; nonce: VS_NONCE_SIZE bytes that never repeat. */
void robot_connected(struct robot *r, const uint8_t *nonce, uint64_t now_ns);

/* 1 if a new beginning is due: the host is silent, has refused, or does not answer. */
int robot_is_lost(const struct robot *r, uint64_t now_ns);

/* Bytes of the stream. <0: close the connection, where there is one. */
int robot_bytes(struct robot *r, const uint8_t *bytes, size_t len, uint64_t now_ns);

/* One datagram; what is no good is dropped and counted. */
void robot_datagram(struct robot *r, const uint8_t *bytes, size_t len, uint64_t now_ns);

/* The next packet for the stream, 0 if none is due; a TELEMETRY goes as a datagram, too. */
size_t robot_packet(struct robot *r, uint8_t buf[VS_DATAGRAM_MAX], uint64_t now_ns,
                    int *is_telemetry);

/* What the wheels may do now; the controller makes its step first where one is due. */
void robot_wheels(struct robot *r, uint64_t now_ns, int16_t *left_steps_s,
                  int16_t *right_steps_s);

/* The controller, which is your own: one step, from the session's values to r's wheels. */
void controller_step(struct robot *r);

#endif
