/* SPDX-License-Identifier: MIT */
#include "vs_clock.h"
#include "vs_packet.h"
#include "vs_peer_robot.h"

#include <string.h>

void vs_peer_init(struct vs_peer *p)
{
    memset(p, 0, sizeof *p);
}

void vs_peer_close(struct vs_peer *p)
{
    struct vs_counters counters = p->counters;

    vs_peer_init(p);
    p->counters = counters;
}

void vs_peer_open(struct vs_peer *p, uint32_t session, uint32_t table_hash,
                  uint64_t peer_send_ns, uint64_t now_ns)
{
    vs_peer_close(p);
    p->session = session;
    p->table_hash = table_hash;
    p->rx_send_ns = peer_send_ns;
    p->rx_ns = now_ns;
    p->udp_ns = now_ns;
    vs_peer_set_keys(p, vs_key_published, vs_key_published);
}

void vs_peer_set_keys(struct vs_peer *p, const uint8_t tx[VS_KEY_SIZE],
                      const uint8_t rx[VS_KEY_SIZE])
{
    memcpy(p->tx_key, tx, VS_KEY_SIZE);
    memcpy(p->rx_key, rx, VS_KEY_SIZE);
}

void vs_peer_adopt(struct vs_peer *p, const struct vs_peer *proved)
{
    uint32_t sums[sizeof p->counters / sizeof(uint32_t)];
    uint32_t more[sizeof p->counters / sizeof(uint32_t)];
    size_t i;

    memcpy(sums, &p->counters, sizeof sums);
    memcpy(more, &proved->counters, sizeof more);
    for (i = 0; i < sizeof sums / sizeof sums[0]; i++)
        sums[i] += more[i];
    *p = *proved;
    memcpy(&p->counters, sums, sizeof sums);
}

int vs_peer_udp_silent(const struct vs_peer *p, uint64_t now_ns)
{
    return p->session != 0 && now_ns - p->udp_ns >= VS_UDP_SILENCE_NS;
}

int vs_peer_over_tcp(const struct vs_peer *p, uint64_t now_ns)
{
    return p->session != 0 && (p->remote_no_udp || vs_peer_udp_silent(p, now_ns));
}

void vs_peer_stamp(const struct vs_peer *p, uint64_t now_ns, struct vs_header *header)
{
    uint64_t hold_us = vs_clock_us(now_ns - p->rx_ns);

    header->flags = vs_peer_udp_silent(p, now_ns) ? VS_FLAG_NO_UDP : 0;
    header->session = p->session;
    header->key = p->session != 0 ? p->tx_key : vs_key_published;
    header->table_hash = p->table_hash;
    header->send_ns = now_ns;
    /* An echo held for longer than hold_us can say would be a lie. */
    header->echo_ns = hold_us <= UINT32_MAX ? p->rx_send_ns : 0;
    header->hold_us = header->echo_ns != 0 ? (uint32_t)hold_us : 0;
}

/* Fills in the header of the next STATE or TELEMETRY. */
static int prepare(const struct vs_peer *p, uint64_t now_ns, struct vs_header *header)
{
    if (p->session == 0)
        return VS_ERR_STATE;
    if (p->tx_sequence == VS_SEQUENCE_MAX)
        return VS_ERR_SEQUENCE;
    vs_peer_stamp(p, now_ns, header);
    header->sequence = p->tx_sequence + 1;
    return VS_OK;
}

static void count_sent(struct vs_peer *p)
{
    p->tx_sequence++;
    p->counters.sent++;
}

int vs_peer_send_state(struct vs_peer *p, const struct vs_table *table,
                       struct vs_header *header, const struct vs_state *state,
                       uint64_t now_ns, uint8_t *buf, size_t cap, size_t *len)
{
    int err = prepare(p, now_ns, header);

    *len = 0;
    if (err == VS_OK)
        err = vs_encode_state(header, table, state, buf, cap, len);
    if (err == VS_OK)
        count_sent(p);
    return err;
}

int vs_peer_send_telemetry(struct vs_peer *p, const struct vs_table *table,
                           struct vs_header *header, const struct vs_telemetry *telemetry,
                           uint64_t now_ns, uint8_t *buf, size_t cap, size_t *len)
{
    int err = prepare(p, now_ns, header);

    *len = 0;
    if (err == VS_OK)
        err = vs_encode_telemetry(header, table, telemetry, buf, cap, len);
    if (err == VS_OK)
        count_sent(p);
    return err;
}

/* Counts why a packet was dropped; returns err. */
static int drop(struct vs_peer *p, int err)
{
    struct vs_counters *c = &p->counters;

    switch (err) {
    case VS_ERR_TAG:
        c->tag++;
        break;
    case VS_ERR_BODY:
        c->body++;
        break;
    case VS_ERR_SESSION:
        c->foreign_session++;
        break;
    case VS_ERR_TABLE:
        c->foreign_table++;
        break;
    case VS_ERR_RUN:
        c->foreign_run++;
        break;
    case VS_ERR_JUMP:
        c->jump++;
        break;
    case VS_ERR_OLDER:
        c->older++;
        break;
    case VS_ERR_REPEATED:
        c->repeated++;
        break;
    default:
        c->malformed++;
        break;
    }
    return err;
}

/* Table and run of a packet of the open session. */
static int check_origin(const struct vs_peer *p, const struct vs_header *h)
{
    if (h->table_hash != p->table_hash)
        return VS_ERR_TABLE;
    /* Of run 0 a robot speaks that has not heard of any yet. */
    if (p->rx_run != 0 && h->run > p->rx_run && h->run - p->rx_run > VS_RUN_JUMP)
        return VS_ERR_JUMP;
    return h->run < p->rx_run ? VS_ERR_RUN : VS_OK;
}

static void hear_udp(struct vs_peer *p, const struct vs_header *h, uint64_t now_ns)
{
    if (h->sequence > p->udp_sequence) {
        p->udp_sequence = h->sequence;
        p->udp_ns = now_ns;
        p->udp_heard = 1;
    }
}

static int check_sequence(const struct vs_peer *p, const struct vs_header *h)
{
    if (h->sequence < p->rx_sequence)
        return VS_ERR_OLDER;
    return h->sequence == p->rx_sequence ? VS_ERR_REPEATED : VS_OK;
}

/* Exactly one packet, if it is of the open session and its peer has made it. */
static int open_packet(struct vs_peer *p, const uint8_t *buf, size_t len,
                       struct vs_header *header, const uint8_t **body, size_t *body_len)
{
    uint32_t session = 0;
    int err = vs_packet_session(buf, len, &session);

    p->counters.received++;
    if (err == VS_OK && (p->session == 0 || session != p->session))
        err = VS_ERR_SESSION;
    if (err == VS_OK)
        err = vs_packet_open_framed(buf, len, p->rx_key, header, body, body_len);
    return err == VS_OK ? VS_OK : drop(p, err);
}

/* Everything but frame, tag and body: VS_OK, or why the packet is dropped, counted. */
static int filter(struct vs_peer *p, uint8_t type, int via, const struct vs_header *h,
                  uint64_t now_ns)
{
    int err;

    if (h->type != type) {
        p->counters.foreign_type++;
        return VS_ERR_TYPE;
    }
    err = check_origin(p, h);
    if (err == VS_OK && h->sequence > p->rx_sequence &&
        h->sequence - p->rx_sequence > VS_SEQUENCE_JUMP)
        err = VS_ERR_JUMP;
    if (err != VS_OK)
        return drop(p, err);
    if (via == VS_VIA_UDP)
        hear_udp(p, h, now_ns);
    err = check_sequence(p, h);
    return err == VS_OK ? VS_OK : drop(p, err);
}

static void note_accepted(struct vs_peer *p, const struct vs_header *h, uint64_t now_ns)
{
    p->rx_sequence = h->sequence;
    p->rx_run = h->run;
    p->rx_send_ns = h->send_ns;
    p->rx_ns = now_ns;
    p->remote_no_udp = (h->flags & VS_FLAG_NO_UDP) != 0;
    p->counters.accepted++;
}

int vs_peer_receive_state(struct vs_peer *p, const struct vs_table *table, int via,
                          const uint8_t *buf, size_t len, uint64_t now_ns,
                          struct vs_header *header, struct vs_state *state)
{
    const uint8_t *body;
    size_t body_len;
    int err = open_packet(p, buf, len, header, &body, &body_len);

    if (err == VS_OK)
        err = filter(p, VS_STATE, via, header, now_ns);
    if (err != VS_OK)
        return err;
    err = vs_decode_state(table, body, body_len, state);
    if (err != VS_OK)
        return drop(p, err);
    note_accepted(p, header, now_ns);
    return VS_OK;
}

int vs_peer_receive_telemetry(struct vs_peer *p, const struct vs_table *table, int via,
                              const uint8_t *buf, size_t len, uint64_t now_ns,
                              struct vs_header *header, struct vs_telemetry *telemetry)
{
    const uint8_t *body;
    size_t body_len;
    int err = open_packet(p, buf, len, header, &body, &body_len);

    if (err == VS_OK)
        err = filter(p, VS_TELEMETRY, via, header, now_ns);
    if (err != VS_OK)
        return err;
    err = vs_decode_telemetry(table, body, body_len, telemetry);
    if (err != VS_OK)
        return drop(p, err);
    note_accepted(p, header, now_ns);
    return VS_OK;
}
