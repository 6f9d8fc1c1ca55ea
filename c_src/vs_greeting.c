/* SPDX-License-Identifier: MIT */
#include "vs_greeting.h"

#include <string.h>

/* What the keys of its sessions are made from. */
static const uint8_t *root_of(const struct vs_session *s)
{
    return s->config.keyed ? s->config.key : vs_key_published;
}

void vs_greeting_open_peer(struct vs_session *s, const struct vs_header *h,
                           const uint8_t *welcome_tag, uint64_t now_ns)
{
    uint8_t down[VS_KEY_SIZE];
    uint8_t up[VS_KEY_SIZE];

    vs_key_session(root_of(s), s->hello_tag, welcome_tag, down, up);
    vs_peer_open(&s->peer, h->session, h->table_hash, h->send_ns, now_ns);
    vs_peer_set_keys(&s->peer, up, down);
}

int vs_greeting_hello(struct vs_session *s, struct vs_header *header,
                      uint8_t *buf, size_t cap, size_t *len)
{
    struct vs_hello hello;
    int err;

    memset(&hello, 0, sizeof hello);
    memcpy(hello.uid, s->config.uid, VS_UID_SIZE);
    memcpy(hello.name, s->config.name, sizeof hello.name);
    memcpy(hello.controller, s->config.controller, sizeof hello.controller);
    memcpy(hello.version, s->config.version, sizeof hello.version);
    memcpy(hello.hash, s->config.hash, sizeof hello.hash);
    memcpy(hello.nonce, s->nonce, VS_NONCE_SIZE);
    hello.started = s->config.started;
    hello.uptime_s = s->uptime_s;
    hello.tag = s->config.tag;
    hello.capabilities = (uint16_t)((s->config.cannot_home ? 0 : VS_CAPABLE_HOME) |
                                    (s->config.keyed ? VS_CAPABLE_KEYED : 0));
    hello.params_room = VS_PARAMS_ROOM;
    hello.entries_room = VS_TABLE_MAX;
    hello.datagram_room = VS_DATAGRAM_MAX;
    header->key = root_of(s);
    err = vs_encode_hello(header, &hello, buf, cap, len);
    if (err == VS_OK) {
        memcpy(s->hello_tag, buf + *len - VS_TAG_SIZE, VS_TAG_SIZE);
        s->phase = VS_PHASE_WAIT;
    }
    return err;
}

int vs_greeting_packet(const struct vs_session *s, size_t len, struct vs_header *h,
                       const uint8_t **body, size_t *body_len)
{
    uint8_t key[VS_KEY_SIZE];

    if (s->phase == VS_PHASE_OPEN)
        return vs_packet_open(s->inbox, len, s->peer.rx_key, h, body, body_len);
    vs_key_answer(root_of(s), s->hello_tag, key);
    return vs_packet_open(s->inbox, len, key, h, body, body_len);
}

int vs_greeting_doubtful(struct vs_session *s, size_t len, enum vs_event *event)
{
    uint8_t key[VS_KEY_SIZE];
    struct vs_header h;
    const uint8_t *body;
    size_t body_len;
    int err;

    vs_key_answer(vs_key_published, s->hello_tag, key);
    err = vs_packet_open(s->inbox, len, key, &h, &body, &body_len);
    if (err == VS_OK && (h.type != VS_REFUSE || s->phase != VS_PHASE_WAIT))
        err = VS_ERR_TAG;
    if (err == VS_OK)
        err = vs_decode_notice(h.type, body, body_len, &s->notice);
    if (err == VS_OK)
        *event = VS_EV_DOUBTED;
    return err;
}
