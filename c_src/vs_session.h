/* SPDX-License-Identifier: MIT */
/*
 * vs_session.h - the robot's end of the protocol, sans-I/O: bytes and times in,
 * bytes and events out. No sockets, no clock, no memory but this struct (14.5 KiB;
 * 2.5 with VS_SMALL), the caller's, used from one thread. now_ns: own monotonic clock [ns].
 *
 *   TCP is up    -> vs_session_connected, send what vs_session_tcp_out gives (HELLO)
 *   TCP bytes    -> vs_session_tcp_in, again while bytes are left; <0: close
 *   a datagram   -> vs_session_udp_in
 *   step, 50 ms  -> vs_session_telemetry; to UDP always, to TCP if vs_session_over_tcp
 *   any wake-up  -> vs_session_tick, again until it gives VS_EV_NONE
 *   TCP is gone  -> vs_session_disconnected
 */
#ifndef VS_SESSION_H
#define VS_SESSION_H

#include "vs_clock.h"
#include "vs_peer.h"

#ifndef VS_SMALL
#define VS_PARAMS_ROOM 4096 /* [byte] of parameters that it can hold; HELLO tells the host */
#endif

#define VS_FUTURE_NS 50000000 /* [ns] a capture further ahead than this is an error */

enum vs_event {
    VS_EV_NONE = 0,
    VS_EV_OPEN = 1,     /* WELCOME came: table, params, seed, timestep are known */
    VS_EV_STATE = 2,    /* a newer STATE was accepted */
    VS_EV_REFUSED = 3,  /* the host refuses: see notice; close and try again later */
    VS_EV_GOODBYE = 4,  /* the host ends the session: see notice; close */
    VS_EV_UDP_LOST = 5, /* no UDP for 1 s: telemetry goes over TCP too */
    VS_EV_UDP_UP = 6,   /* UDP is heard again */
    VS_EV_DOUBTED = 7   /* somebody without the key refuses: see notice; or, in an open session, ends
                         * it; nothing has changed */
};

enum vs_phase {
    VS_PHASE_DOWN = 0,    /* no TCP connection, or it is to be closed */
    VS_PHASE_CONNECT = 1, /* HELLO is due */
    VS_PHASE_WAIT = 2,    /* HELLO was given out, no answer yet */
    VS_PHASE_OPEN = 3     /* WELCOME came */
};

struct vs_session_config {
    uint8_t uid[VS_UID_SIZE];
    uint64_t started; /* random, of this start of the daemon */
    uint16_t tag;
    uint8_t keyed;             /* it has a key, and obeys only a host that has it, too */
    uint8_t key[VS_KEY_SIZE];  /* its own; of no meaning unless keyed */
    uint8_t cannot_home;       /* it cannot drive to a goal by itself: VS_HOME stops it */
    uint8_t clock_slewed; /* now_ns is of a clock that may be slewed: vs_clock.h */
    char name[VS_NAME_MAX + 1];
    char controller[VS_NAME_MAX + 1];
    char version[VS_NAME_MAX + 1];
    char hash[VS_NAME_MAX + 1]; /* of the controller's source */
};

/* One sensor's newest value; data points into the session, valid until the next call. */
struct vs_value {
    const uint8_t *data;
    uint16_t size;       /* [byte] */
    uint8_t known;       /* 0: never measured, data is zeros and capture_ns 0 */
    uint64_t capture_ns; /* host's clock */
};

/* Read-only for the caller. What STATE brought stays until the next WELCOME. */
struct vs_session {
    struct vs_session_config config;
    uint8_t phase;         /* enum vs_phase */
    uint8_t open;          /* 1 while phase is VS_PHASE_OPEN */
    uint8_t wanted;        /* enum vs_run_state; VS_IDLE until the first STATE */
    uint8_t udp_lost;      /* between VS_EV_UDP_LOST and VS_EV_UDP_UP */
    uint8_t goodbye_due;
    uint8_t nonce[VS_NONCE_SIZE];    /* own, of this connection */
    uint8_t hello_tag[VS_TAG_SIZE];  /* of the HELLO that was given out */
    uint32_t uptime_s;     /* [s] of the board when the connection was made */
    uint32_t offer;        /* counts the WELCOMEs whose table or params differ from those before */
    uint32_t seed;
    uint64_t timestep_ns;  /* [ns] length of a timestep */
#ifndef VS_SMALL
    double timestep_s;     /* [s] the same: divided once, not in every control step */
#endif
    uint32_t run;          /* of the newest STATE */
    uint32_t timestep;
    uint32_t from_timestep;
    uint64_t capture_ns;   /* host's clock: of the newest STATE */
    uint64_t received_ns;  /* own clock: newest accepted STATE; 0 = none in this session */
    uint64_t newest_capture_ns; /* host's clock: newest of the session that is not in the future */
    uint64_t fresh_ns;     /* own clock: first receipt of the newest capture; 0 = not yet */
    struct vs_clock clock;
    struct vs_peer peer;   /* session id, sequences, counters, peer.udp_ns */
    struct vs_table table;
    struct vs_state state; /* newest readings */
    struct vs_notice notice; /* of the host's REFUSE or GOODBYE, or of our GOODBYE */
    size_t inbox_len;
    /* What was never received is never written: pages that nobody touches cost no memory. */
    char params[VS_PARAMS_ROOM + 1]; /* lines "key=value\n" */
    /* TCP bytes of an incomplete packet, at most a WELCOME */
    uint8_t inbox[VS_PACKET_MIN + VS_NONCE_SIZE + 12 + VS_PARAMS_ROOM + VS_TABLE_BYTES];
};

/* Errors: VS_ERR_TEXT if name or controller is no clean text. */
int vs_session_init(struct vs_session *s, const struct vs_session_config *config);

/* nonce: from the system's generator; uptime_s: [s] since the board started. */
void vs_session_connected(struct vs_session *s, const uint8_t nonce[VS_NONCE_SIZE],
                          uint32_t uptime_s);
void vs_session_disconnected(struct vs_session *s);

/*
 * Takes TCP bytes in any chunking, at most up to the end of one packet; *used says
 * how many (> 0 if len > 0). <0: the host broke the protocol, close the connection.
 * A STATE that the filter drops is no error.
 */
int vs_session_tcp_in(struct vs_session *s, const uint8_t *buf, size_t len,
                      uint64_t now_ns, size_t *used, enum vs_event *event);

/* The packet due on TCP (HELLO or GOODBYE), given once; *len 0 if none. Needs cap
 * >= 512, else VS_ERR_SPACE. */
int vs_session_tcp_out(struct vs_session *s, uint8_t *buf, size_t cap,
                       uint64_t now_ns, size_t *len);

/* One datagram: VS_OK accepted, else why it was dropped (counted). */
int vs_session_udp_in(struct vs_session *s, const uint8_t *buf, size_t len,
                      uint64_t now_ns, enum vs_event *event);

/* Events that time brings: VS_EV_UDP_LOST, VS_EV_UDP_UP. */
void vs_session_tick(struct vs_session *s, uint64_t now_ns, enum vs_event *event);

/* One TELEMETRY. Of *t the fields wanted, wanted_run, received, old, foreign, corrupt
 * and clock_bound_us are filled in. Errors: as vs_peer_send_telemetry; VS_ERR_SEQUENCE
 * makes GOODBYE (VS_BYE_RENEW) due. */
int vs_session_telemetry(struct vs_session *s, struct vs_telemetry *t, uint64_t now_ns,
                         uint8_t *buf, size_t cap, size_t *len);
int vs_session_over_tcp(const struct vs_session *s, uint64_t now_ns);

/* Makes GOODBYE due (cut to VS_TEXT_MAX); the session is closed once it was given out.
 * Errors: VS_ERR_STATE if not open. */
int vs_session_goodbye(struct vs_session *s, uint8_t cause, const char *text);

/* Value of table entry index. Errors: VS_ERR_NOT_FOUND (no such sensor). */
int vs_session_value(const struct vs_session *s, int index, struct vs_value *out);

/* Age [ns] at now_ns of something captured at capture_ns (host's clock), >= 0;
 * UINT64_MAX if the clock is not known yet. Accurate to vs_clock_estimate's bound. */
uint64_t vs_session_age_ns(const struct vs_session *s, uint64_t capture_ns, uint64_t now_ns);

#endif
