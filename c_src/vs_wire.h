/* SPDX-License-Identifier: MIT */
/*
 * vs_wire.h - frame of every vsense packet, protocol version 3 (PROTOCOL.md):
 * 56-byte header, body, 16-byte tag. The same bytes travel as one UDP datagram or
 * back to back on TCP. Bodies: vs_body.h.
 */
#ifndef VS_WIRE_H
#define VS_WIRE_H

#include <stddef.h>
#include <stdint.h>

#include "vs_err.h"
#ifdef VS_SMALL
#include "vs_small.h"
#endif
#include "vs_tag.h"

#define VS_MAGIC 0x5356       /* the bytes 'V' 'S' */
#define VS_VERSION 3
#define VS_PREFIX_SIZE 8      /* magic..length: enough to frame a stream */
#define VS_HEADER_SIZE 56
#define VS_PACKET_MIN 72      /* header + tag */
#ifndef VS_SMALL
#define VS_DATAGRAM_MAX 1200  /* STATE and TELEMETRY, on UDP and on TCP */
#endif
#define VS_GREETING_MAX 512   /* HELLO, REFUSE, GOODBYE */
#define VS_PACKET_MAX 8192    /* WELCOME */

#define VS_SEQUENCE_MAX 0xFFFFFFFE /* newest sequence number that may be sent */

enum vs_type {
    VS_HELLO = 1,    /* robot -> host, TCP: who I am */
    VS_WELCOME = 2,  /* host -> robot, TCP: session, sensor table, parameters */
    VS_REFUSE = 3,   /* host -> robot, TCP: no session, and why */
    VS_GOODBYE = 4,  /* both ways, TCP: the session ends, and why */
    VS_STATE = 5,    /* host -> robot, UDP or TCP: all readings, wanted state */
    VS_TELEMETRY = 6 /* robot -> host, UDP or TCP: actual state, all actuators */
};

/* Bits of vs_header.flags; the others are sent as 0 and ignored. */
enum vs_flag {
    VS_FLAG_NO_UDP = 1 /* the sender has heard no UDP from its peer for 1 s */
};

/* Times are integer nanoseconds of a monotonic clock; whose, says each field. */
struct vs_header {
    uint8_t type;        /* enum vs_type */
    uint16_t flags;      /* enum vs_flag */
    uint16_t length;     /* [byte] whole packet; encoders compute it */
    uint32_t session;    /* 0 in HELLO and REFUSE */
    uint32_t sequence;   /* 1.. per session and direction for STATE and TELEMETRY;
                          * 0 in packets that TCP orders */
    uint32_t run;        /* number of the experiment's run, only ever grows */
    uint32_t timestep;   /* within the run */
    uint64_t capture_ns; /* [ns] host's clock: when the arena was seen */
    uint64_t send_ns;    /* [ns] sender's clock */
    uint64_t echo_ns;    /* [ns] receiver's clock: send_ns of its newest packet
                          * that the sender accepted; 0 = none */
    uint32_t hold_us;    /* [us] sender's clock: how long ago that packet came */
    uint32_t table_hash; /* CRC-32 of the sensor table; 0 in HELLO and REFUSE */
    const uint8_t *key;  /* encoders tag with it; NULL: vs_key_published */
};

/* Largest packet of a type in bytes; 0 if the type is unknown. */
size_t vs_packet_limit(uint8_t type);

/*
 * Frames a stream: looks at the first len bytes of a packet. VS_OK with the
 * whole packet's length in *length (from 8 bytes on), VS_ERR_SHORT while too
 * few bytes are there, else VS_ERR_MAGIC, _VERSION, _TYPE or _LENGTH at the
 * first byte that is wrong. Never reads the body.
 */
int vs_packet_length(const uint8_t *buf, size_t len, size_t *length);

/*
 * Checks frame and tag of exactly one packet (a datagram, or what
 * vs_packet_length framed) and reads its header. *body points into buf; key NULL is
 * vs_key_published. Errors: those of vs_packet_length, VS_ERR_SHORT, VS_ERR_LENGTH
 * for bytes left over, VS_ERR_TAG. On error nothing is written.
 */
int vs_packet_open(const uint8_t *buf, size_t len, const uint8_t *key,
                   struct vs_header *header, const uint8_t **body, size_t *body_len);

/*
 * The session that exactly one packet names, to find the key it must be opened with:
 * nothing else of it may be believed before. Errors: those of vs_packet_open but
 * VS_ERR_TAG.
 */
int vs_packet_session(const uint8_t *buf, size_t len, uint32_t *session);

#endif
