/* SPDX-License-Identifier: MIT */
/* vs_greeting.h - HELLO, what answers it, and the keys that follow from both: a part of
 * vs_session.c. Internal to libvsense. */
#ifndef VS_GREETING_H
#define VS_GREETING_H

#include "vs_session.h"

/* Writes the HELLO; its tag is kept. Sets header's key. */
int vs_greeting_hello(struct vs_session *s, struct vs_header *header, uint8_t *buf, size_t cap,
                      size_t *len);

/* Opens what is no STATE, len bytes in the inbox, with the key that it must have. */
int vs_greeting_packet(const struct vs_session *s, size_t len, struct vs_header *h,
                       const uint8_t **body, size_t *body_len);

/* A REFUSE of a host that does not know the key, len bytes in the inbox, is something to say and
 * nothing to act on: anybody may have made it. */
int vs_greeting_doubtful(struct vs_session *s, size_t len, enum vs_event *event);

/* Opens the link of the session that a WELCOME with this header and tag offers, with its keys. */
void vs_greeting_open_peer(struct vs_session *s, const struct vs_header *h,
                           const uint8_t *welcome_tag, uint64_t now_ns);

#endif
