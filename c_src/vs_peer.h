/* SPDX-License-Identifier: MIT */
/*
 * vs_peer.h - what either end remembers about the other: sequence numbers, the
 * acceptance filter with its counters, the echo for the peer's clock, and
 * whether UDP gets through. Robot and host run this same code. Sans-I/O: bytes
 * and times are arguments; now_ns is the caller's own monotonic clock [ns].
 */
#ifndef VS_PEER_H
#define VS_PEER_H

#include "vs_body.h"

#define VS_UDP_SILENCE_NS 1000000000 /* [ns] without UDP: state goes over TCP */
/* Further ahead of the newest one than an honest peer gets, who sends some 40 packets a second and
 * whose silence of 2 s ends the session: such a packet would make all that follow it old. */
#define VS_SEQUENCE_JUMP 1000
#define VS_RUN_JUMP 100

/* How a packet came. */
enum vs_via { VS_VIA_TCP = 0, VS_VIA_UDP = 1 };

/*
 * Counters of STATE and TELEMETRY; they survive sessions, never go down, wrap at
 * 2^32. received = accepted + the sum of all fields below it.
 */
struct vs_counters {
    uint32_t sent;
    uint32_t received; /* everything that arrived as a packet, good or bad */
    uint32_t accepted;
    uint32_t malformed;       /* corrupt: no vsense frame (magic, version, length) */
    uint32_t tag;             /* corrupt: damaged, or made with another key */
    uint32_t body;            /* corrupt: frame right, body wrong */
    uint32_t foreign_type;    /* foreign: a type not expected from this peer */
    uint32_t foreign_session; /* foreign: another session, or none is open */
    uint32_t foreign_table;   /* foreign: another sensor table */
    uint32_t foreign_run;     /* foreign: an earlier run */
    uint32_t jump;            /* foreign: sequence or run too far ahead to be true */
    uint32_t older;           /* old: sequence below the newest accepted */
    uint32_t repeated;        /* old: the newest accepted once more */
};

/* Read-only for the caller. */
struct vs_peer {
    uint32_t session;      /* 0 = none is open */
    uint32_t table_hash;
    uint32_t tx_sequence;  /* newest sent, 0 = none */
    uint32_t rx_sequence;  /* newest accepted, 0 = none */
    uint32_t rx_run;       /* newest run accepted */
    uint32_t udp_sequence; /* newest heard by UDP */
    uint64_t rx_send_ns;   /* peer's clock: send_ns of its newest accepted packet */
    uint64_t rx_ns;        /* own clock: when that came */
    uint64_t udp_ns;       /* own clock: newest datagram of this session, else its opening */
    uint8_t tx_key[VS_KEY_SIZE]; /* what is sent is tagged with it, what comes with the other */
    uint8_t rx_key[VS_KEY_SIZE];
    uint8_t udp_heard;     /* a datagram of this session has come */
    uint8_t remote_no_udp; /* the peer's newest packet says VS_FLAG_NO_UDP */
    struct vs_counters counters;
};

/* Forgets everything, counters included. */
void vs_peer_init(struct vs_peer *p);

/*
 * Opens a session: sequences start anew, counters go on. peer_send_ns and now_ns
 * are send_ns and receipt of the peer's greeting (HELLO at the host, WELCOME at
 * the robot): the first echo. session must not be 0.
 */
void vs_peer_open(struct vs_peer *p, uint32_t session, uint32_t table_hash,
                  uint64_t peer_send_ns, uint64_t now_ns);

/* Sets the keys of the open session. Until then it has the published one. */
void vs_peer_set_keys(struct vs_peer *p, const uint8_t tx[VS_KEY_SIZE],
                      const uint8_t rx[VS_KEY_SIZE]);

/* Takes over the open session of another one, whose greeting was only now proved to be true;
 * counters are the sums of both. */
void vs_peer_adopt(struct vs_peer *p, const struct vs_peer *proved);

/* Ends the session; every packet is foreign from now on. */
void vs_peer_close(struct vs_peer *p);

/* 1 if for VS_UDP_SILENCE_NS no datagram of the open session was heard, else 0. */
int vs_peer_udp_silent(const struct vs_peer *p, uint64_t now_ns);

/* 1 if what is sent must go over TCP as well as UDP: either end hears no UDP. */
int vs_peer_over_tcp(const struct vs_peer *p, uint64_t now_ns);

/*
 * Fills session, table hash, send time, echo, hold, flags and key of any packet to this
 * peer; the rest of *header is left alone. Used for WELCOME, REFUSE and GOODBYE;
 * the send functions below do it themselves.
 */
void vs_peer_stamp(const struct vs_peer *p, uint64_t now_ns, struct vs_header *header);

/*
 * One packet with the next sequence number. The caller sets header's run, timestep
 * and capture_ns; the rest is filled in. Send the same bytes on every path it is to
 * take: the peer takes the first and counts the other as repeated. Errors:
 * VS_ERR_STATE (no session), VS_ERR_SEQUENCE, those of vs_encode_*; no sequence
 * number is then used up.
 */
int vs_peer_send_state(struct vs_peer *p, const struct vs_table *table,
                       struct vs_header *header, const struct vs_state *state,
                       uint64_t now_ns, uint8_t *buf, size_t cap, size_t *len);

/*
 * The acceptance filter for exactly one packet. VS_OK: accepted, *header and the body
 * are written. Else the reason why it was dropped, counted, outputs untouched.
 * Checked in this order: frame, session, tag, type, table, run, sequence strictly newer,
 * body. A datagram of this session whose sequence is the newest heard by UDP
 * shows that UDP works, even if TCP was faster.
 */
int vs_peer_receive_telemetry(struct vs_peer *p, const struct vs_table *table, int via,
                              const uint8_t *buf, size_t len, uint64_t now_ns,
                              struct vs_header *header, struct vs_telemetry *telemetry);

#endif
