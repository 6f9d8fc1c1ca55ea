/* SPDX-License-Identifier: MIT */
/*
 * net.h - the worker's sockets: one TCP connection that is tried again for ever, and a UDP
 * socket that is bound to no address: with a new one, or none for a while, the robot goes on.
 * Bytes go to and from the session; nothing blocks.
 */
#ifndef VS_NET_H
#define VS_NET_H

#include <poll.h>

#include "../c_src/vs_session.h"

#define VS_NET_RETRY_NS 200000000u    /* [ns] between two tries to connect */
#define VS_NET_ATTEMPT_NS 300000000u  /* [ns] the first try may take, each later one twice as long */
#define VS_NET_LONGEST_NS 1500000000u /* [ns] up to this: a round trip may take 1 s */
#define VS_NET_REFUSED_NS 1000000000u /* [ns] until the next try once refused */
#define VS_NET_TAKEN_NS 5000000000u   /* [ns] until the next try once taken over */
#define VS_NET_SILENCE_NS 2000000000u /* [ns] without a valid packet: connect anew */

/* Why a connection ended: the host is older or newer. */
extern const char vs_net_version[];

enum vs_net_phase { VS_NET_DOWN = 0, VS_NET_CONNECTING = 1, VS_NET_UP = 2 };

enum vs_net_result {
    VS_NET_NOTHING = 0, /* nothing happened */
    VS_NET_EVENT = 1,   /* bytes went to the session; *event says what, maybe VS_EV_NONE */
    VS_NET_LOST = 2,    /* the connection ended; net->why says why */
    VS_NET_NO_WAY = 3   /* no socket gets to the host; net->trouble says why, once */
};

/* Room for a datagram at the address of a word, where its tag costs less. */
union vs_net_datagram {
    uint32_t for_alignment;
    uint8_t bytes[VS_DATAGRAM_MAX + 1];
};

/* Read-only for the caller, but for sent. */
struct vs_net {
    uint32_t host;      /* IPv4, network order */
    uint16_t port;
    int fds[2];         /* TCP, UDP; -1 = none */
    uint8_t phase;      /* enum vs_net_phase */
    uint64_t next_ns;   /* DOWN: try then; CONNECTING: give up then */
    uint32_t attempt_ns; /* what the present try may take */
    uint64_t heard_ns;  /* UP: newest valid packet, else when it came up */
    int trouble;        /* errno of the newest try that got no way, 0 = none */
    const char *why;    /* the connection last ended: one phrase */
    uint8_t readable[2]; /* what poll() said of fds; 0 once read */
    uint8_t has_datagram;
    uint8_t closed;     /* by the host */
    size_t datagram_len;
    size_t in_len;
    size_t in_pos;
    size_t out_len;
    size_t out_pos;
    size_t newest_len;
    size_t sent_len;
    /* What holds nothing yet was never written: pages that nobody touches cost no memory. */
    union vs_net_datagram datagram;
    union vs_net_datagram sent;         /* the newest telemetry */
    uint8_t in[1792];                   /* of the stream, at a time */
    uint8_t out[VS_DATAGRAM_MAX];       /* the packet that TCP is sending */
    uint8_t newest[VS_DATAGRAM_MAX];   /* telemetry waiting for TCP: newest wins */
};

/* Returns 0, or -1: address is no numeric IPv4 address. Opens nothing yet. */
int vs_net_open(struct vs_net *net, const char *address, uint16_t port);

/* Connects, gives up, notices silence. Returns VS_NET_LOST once for an end, VS_NET_NO_WAY
 * once for a reason. */
enum vs_net_result vs_net_tick(struct vs_net *net, struct vs_session *session,
                               uint64_t now_ns);

/* Reads what poll() said is there: one datagram, or what TCP has. 1: vs_net_take has work,
 * 0: nothing came. A second datagram waits for the next poll(). */
int vs_net_read(struct vs_net *net);

/* Hands what was read to the session, at most one packet. The two times are of now, after
 * vs_net_read: a packet that came before its time would make a clock sample a lie. */
enum vs_net_result vs_net_take(struct vs_net *net, struct vs_session *session,
                                  uint64_t now_ns, uint64_t session_ns, enum vs_event *event);

/* Sends the telemetry packet in sent by UDP, and by TCP as well if over_tcp. */
void vs_net_send(struct vs_net *net, int over_tcp);

/* Writes what TCP has to send, as far as it takes it. */
void vs_net_flush(struct vs_net *net, struct vs_session *session, uint64_t session_ns);

/* Ends the connection; the next try comes wait_ns after now_ns. */
void vs_net_close(struct vs_net *net, struct vs_session *session, const char *why,
                  uint64_t now_ns, uint64_t wait_ns);

/* Hands the last packets to the system and waits, at the longest 50 ms, until the
 * host has closed. For the daemon's end. */
void vs_net_finish(struct vs_net *net, struct vs_session *session, uint64_t session_ns);

/* Fills what poll() has to wait for: TCP, UDP. */
void vs_net_poll(const struct vs_net *net, struct pollfd fds[2]);

/* Takes over what poll() said of them. */
void vs_net_polled(struct vs_net *net, const struct pollfd fds[2]);

/* When vs_net_tick has to be called at the latest. */
uint64_t vs_net_wake_ns(const struct vs_net *net);

#endif
