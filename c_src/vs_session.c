/* SPDX-License-Identifier: MIT */
#include "vs_session.h"

#include <string.h>

#include "vs_bytes.h"
#include "vs_greeting.h"
#include "vs_offer.h"
#include "vs_peer_robot.h"

static int is_text(const char *text)
{
    size_t len = strlen(text);

    return len <= VS_NAME_MAX && vs_text_check((const uint8_t *)text, len, 0) == VS_OK;
}

int vs_session_init(struct vs_session *s, const struct vs_session_config *config)
{
    if (!is_text(config->name) || !is_text(config->controller))
        return VS_ERR_TEXT;
    memset(s, 0, offsetof(struct vs_session, params));
    s->params[0] = '\0';
    s->config = *config;
    vs_peer_init(&s->peer);
    vs_table_init(&s->table);
    vs_clock_init(&s->clock, s->config.clock_slewed);
    return VS_OK;
}

/* Ends the session at this end, into phase VS_PHASE_DOWN. */
static void end(struct vs_session *s)
{
    s->phase = VS_PHASE_DOWN;
    s->open = 0;
    s->udp_lost = 0;
    s->goodbye_due = 0;
    s->inbox_len = 0;
    vs_peer_close(&s->peer);
}

void vs_session_connected(struct vs_session *s, const uint8_t nonce[VS_NONCE_SIZE],
                          uint32_t uptime_s)
{
    end(s);
    memcpy(s->nonce, nonce, VS_NONCE_SIZE);
    s->uptime_s = uptime_s;
    s->phase = VS_PHASE_CONNECT;
}

void vs_session_disconnected(struct vs_session *s)
{
    end(s);
}

/* Forgets what the last session's STATE packets brought. */
static void forget_state(struct vs_session *s)
{
    uint32_t i;

    memset(&s->state, 0, sizeof s->state);
    for (i = 0; i < VS_TABLE_MAX; i++)
        s->state.older_us[i] = VS_NEVER_US;
    s->wanted = VS_IDLE;
    s->run = 0;
    s->timestep = 0;
    s->from_timestep = 0;
    s->capture_ns = 0;
    s->received_ns = 0;
    s->newest_capture_ns = 0;
    s->fresh_ns = 0;
}

/* body ends where the tag begins. */
static int on_welcome(struct vs_session *s, const struct vs_header *h,
                      const uint8_t *body, size_t len, uint64_t now_ns)
{
    struct vs_welcome w;
    int err;

    if (s->phase != VS_PHASE_WAIT)
        return VS_ERR_TYPE;
    err = vs_decode_welcome(body, len, &w);
    if (err != VS_OK)
        return err;
    if (h->session == 0)
        return VS_ERR_SESSION;
    if (h->table_hash != w.table.hash)
        return VS_ERR_TABLE;
    err = vs_session_offer(s, &w);
    if (err != VS_OK)
        return err;
    forget_state(s);
    vs_greeting_open_peer(s, h, body + len, now_ns);
    vs_clock_init(&s->clock, s->config.clock_slewed);
    /* A greeting without an echo is no fault: the first STATE brings one. */
    (void)vs_clock_sample(&s->clock, h->echo_ns, h->send_ns, h->hold_us, now_ns);
    return VS_OK;
}

/* REFUSE answers HELLO; GOODBYE ends the session that is open. */
static int on_notice(struct vs_session *s, const struct vs_header *h,
                     const uint8_t *body, size_t len)
{
    int err;

    if (s->phase != (h->type == VS_REFUSE ? VS_PHASE_WAIT : VS_PHASE_OPEN))
        return VS_ERR_TYPE;
    if (h->session != s->peer.session)
        return VS_ERR_SESSION;
    err = vs_decode_notice(h->type, body, len, &s->notice);
    if (err == VS_OK)
        end(s);
    return err;
}

/* A capture that not even the clock's bound explains: it would be the newest for ever. */
static int is_in_future(const struct vs_session *s, uint64_t capture_ns, uint64_t now_ns)
{
    uint64_t host_ns = now_ns + (uint64_t)s->clock.offset_ns;
    int64_t offset_ns;
    uint64_t bound_ns;

    if (capture_ns <= host_ns || /* mostly, and then nobody need know the bound */
        vs_clock_estimate(&s->clock, now_ns, &offset_ns, &bound_ns) != VS_OK)
        return 0;
    return capture_ns - host_ns > bound_ns + VS_FUTURE_NS;
}

static void note_capture(struct vs_session *s, uint64_t capture_ns, uint64_t now_ns)
{
    if (is_in_future(s, s->newest_capture_ns, now_ns))
        s->newest_capture_ns = 0; /* it came before the clock was known */
    if (capture_ns > s->newest_capture_ns && !is_in_future(s, capture_ns, now_ns)) {
        s->newest_capture_ns = capture_ns;
        s->fresh_ns = now_ns;
    }
}

/* Through the acceptance filter: the newest STATE replaces all readings. */
static int on_state(struct vs_session *s, int via, const uint8_t *buf, size_t len,
                    uint64_t now_ns, enum vs_event *event)
{
    struct vs_header h;
    int err = vs_peer_receive_state(&s->peer, &s->table, via, buf, len, now_ns, &h, &s->state);

    if (err != VS_OK)
        return err;
    (void)vs_clock_sample(&s->clock, h.echo_ns, h.send_ns, h.hold_us, now_ns);
    s->wanted = s->state.wanted;
    s->from_timestep = s->state.from_timestep;
    s->run = h.run;
    s->timestep = h.timestep;
    s->capture_ns = h.capture_ns;
    s->received_ns = now_ns;
    note_capture(s, h.capture_ns, now_ns);
    *event = VS_EV_STATE;
    return VS_OK;
}

/* One whole packet from TCP, len bytes in the inbox. */
static int on_packet(struct vs_session *s, size_t len, uint64_t now_ns, enum vs_event *event)
{
    struct vs_header h;
    const uint8_t *body;
    size_t body_len;
    int err = vs_greeting_packet(s, len, &h, &body, &body_len);

    if (err == VS_ERR_TAG && s->phase == VS_PHASE_OPEN &&
        (s->inbox[3] == VS_GOODBYE || s->inbox[3] == VS_REFUSE)) {
        s->peer.counters.received++;
        s->peer.counters.tag++;
        *event = VS_EV_DOUBTED;
        return VS_OK;
    }
    if (err == VS_ERR_TAG && s->config.keyed)
        return vs_greeting_doubtful(s, len, event);
    if (err != VS_OK)
        return err;
    switch (h.type) {
    case VS_WELCOME:
        err = on_welcome(s, &h, body, body_len, now_ns);
        *event = err == VS_OK ? VS_EV_OPEN : VS_EV_NONE;
        return err;
    case VS_REFUSE:
    case VS_GOODBYE:
        err = on_notice(s, &h, body, body_len);
        if (err == VS_OK)
            *event = h.type == VS_REFUSE ? VS_EV_REFUSED : VS_EV_GOODBYE;
        return err;
    case VS_STATE:
        /* What the filter drops was counted and does not harm the stream. */
        (void)on_state(s, VS_VIA_TCP, s->inbox, len, now_ns, event);
        return VS_OK;
    default:
        return VS_ERR_TYPE;
    }
}

/* Moves bytes to the inbox up to the end of one packet. VS_OK: it is whole. */
static int fill(struct vs_session *s, const uint8_t *buf, size_t len,
                size_t *used, size_t *whole)
{
    for (;;) {
        size_t goal = VS_PREFIX_SIZE;
        size_t step;
        int err = vs_packet_length(s->inbox, s->inbox_len, whole);

        if (err == VS_OK && *whole > sizeof s->inbox)
            return VS_ERR_SPACE;
        if (err == VS_OK)
            goal = *whole;
        else if (err != VS_ERR_SHORT)
            return err;
        if (s->inbox_len == goal)
            return VS_OK;
        step = goal - s->inbox_len;
        if (step > len - *used)
            step = len - *used;
        if (step == 0)
            return VS_ERR_SHORT;
        memcpy(s->inbox + s->inbox_len, buf + *used, step);
        s->inbox_len += step;
        *used += step;
    }
}

int vs_session_tcp_in(struct vs_session *s, const uint8_t *buf, size_t len,
                      uint64_t now_ns, size_t *used, enum vs_event *event)
{
    size_t whole = 0;
    int err;

    *used = 0;
    *event = VS_EV_NONE;
    if (s->phase == VS_PHASE_DOWN)
        return VS_ERR_STATE;
    err = fill(s, buf, len, used, &whole);
    if (err == VS_ERR_SHORT)
        return VS_OK;
    if (err == VS_OK)
        err = on_packet(s, whole, now_ns, event);
    s->inbox_len = 0;
    if (err != VS_OK)
        end(s);
    return err;
}

int vs_session_tcp_out(struct vs_session *s, uint8_t *buf, size_t cap,
                       uint64_t now_ns, size_t *len)
{
    struct vs_header header;
    int err = VS_OK;

    *len = 0;
    memset(&header, 0, sizeof header);
    vs_peer_stamp(&s->peer, now_ns, &header);
    if (s->phase == VS_PHASE_CONNECT) {
        err = vs_greeting_hello(s, &header, buf, cap, len);
    } else if (s->goodbye_due) {
        header.type = VS_GOODBYE;
        err = vs_encode_notice(&header, &s->notice, buf, cap, len);
        if (err == VS_OK)
            end(s);
    }
    return err;
}

int vs_session_udp_in(struct vs_session *s, const uint8_t *buf, size_t len,
                      uint64_t now_ns, enum vs_event *event)
{
    *event = VS_EV_NONE;
    return on_state(s, VS_VIA_UDP, buf, len, now_ns, event);
}

void vs_session_tick(struct vs_session *s, uint64_t now_ns, enum vs_event *event)
{
    uint8_t lost = (uint8_t)vs_peer_udp_silent(&s->peer, now_ns);

    *event = VS_EV_NONE;
    if (lost != s->udp_lost)
        *event = lost ? VS_EV_UDP_LOST : VS_EV_UDP_UP;
    s->udp_lost = lost;
}

/* Bound of the clock estimate as TELEMETRY says it, rounded up. */
static uint32_t clock_bound_us(const struct vs_clock *clock, uint64_t now_ns)
{
    int64_t offset_ns;
    uint64_t bound_ns;
    uint64_t bound_us;

    if (vs_clock_estimate(clock, now_ns, &offset_ns, &bound_ns) != VS_OK)
        return VS_NEVER_US;
    bound_us = vs_clock_us(bound_ns) + 1;
    return bound_us < VS_NEVER_US ? (uint32_t)bound_us : VS_NEVER_US - 1;
}

int vs_session_telemetry(struct vs_session *s, struct vs_telemetry *t, uint64_t now_ns,
                         uint8_t *buf, size_t cap, size_t *len)
{
    const struct vs_counters *c = &s->peer.counters;
    struct vs_header header; /* but for type and length, which are the encoder's */
    int err;

    header.run = s->run;
    header.timestep = s->timestep;
    header.capture_ns = s->capture_ns;
    t->wanted = s->wanted;
    t->wanted_run = s->run;
    t->received = c->received;
    t->old = c->older + c->repeated;
    t->foreign =
        c->foreign_type + c->foreign_session + c->foreign_table + c->foreign_run + c->jump;
    t->corrupt = c->malformed + c->tag + c->body;
    t->clock_bound_us = clock_bound_us(&s->clock, now_ns);
    err = vs_peer_send_telemetry(&s->peer, &s->table, &header, t, now_ns, buf, cap, len);
    if (err == VS_ERR_SEQUENCE)
        (void)vs_session_goodbye(s, VS_BYE_RENEW, "sequence numbers are used up");
    return err;
}

int vs_session_over_tcp(const struct vs_session *s, uint64_t now_ns)
{
    /* The host believes no greeting before the first packet: that one must not be lost. */
    return s->open && (s->peer.tx_sequence <= 1 || vs_peer_over_tcp(&s->peer, now_ns));
}

int vs_session_goodbye(struct vs_session *s, uint8_t cause, const char *text)
{
    size_t len = strlen(text);

    if (!s->open)
        return VS_ERR_STATE;
    if (len > VS_TEXT_MAX)
        len = VS_TEXT_MAX;
    /* The cut must not leave half a character. */
    while (vs_text_check((const uint8_t *)text, len, 0) != VS_OK)
        len--;
    memset(&s->notice, 0, sizeof s->notice);
    s->notice.code = cause;
    memcpy(s->notice.text, text, len);
    s->goodbye_due = 1;
    return VS_OK;
}

int vs_session_value(const struct vs_session *s, int index, struct vs_value *out)
{
    const struct vs_entry *e;
    uint32_t older_us;
    uint64_t older_ns;

    if (index < 0 || (uint32_t)index >= s->table.count)
        return VS_ERR_NOT_FOUND;
    e = &s->table.entries[index];
    if (e->direction != VS_SENSOR)
        return VS_ERR_NOT_FOUND;
    older_us = s->state.older_us[e->rank];
    older_ns = (uint64_t)older_us * 1000;
    out->data = s->state.payload + e->offset;
    out->size = e->size;
    out->known = older_us != VS_NEVER_US;
    out->capture_ns = out->known && s->capture_ns > older_ns ? s->capture_ns - older_ns : 0;
    return VS_OK;
}

uint64_t vs_session_age_ns(const struct vs_session *s, uint64_t capture_ns, uint64_t now_ns)
{
    uint64_t age_ns = now_ns + (uint64_t)s->clock.offset_ns - capture_ns;

    if (s->clock.samples == 0)
        return UINT64_MAX;
    /* A capture in the future by less than the clock's bound is a fresh one. */
    return age_ns <= INT64_MAX ? age_ns : 0;
}
