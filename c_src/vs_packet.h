/* SPDX-License-Identifier: MIT */
/* vs_packet.h - how vs_body.h writes the frame of vs_wire.h, and vs_peer.h reads it. Internal to
 * libvsense. */
#ifndef VS_PACKET_H
#define VS_PACKET_H

#include "vs_bytes.h"
#include "vs_wire.h"

/*
 * Begins a packet of the given type: writes the otherwise given header (its length is left
 * open) to buf. The body follows with vs_put_*, then vs_packet_end closes the packet.
 */
void vs_packet_begin(struct vs_writer *w, uint8_t type, const struct vs_header *header,
                     uint8_t *buf, size_t cap);

/*
 * Ends a packet: length and tag. *len is the whole
 * packet's size in bytes, 0 on error. Errors: the writer's first, VS_ERR_TYPE,
 * VS_ERR_SPACE if larger than vs_packet_limit or than buf.
 */
int vs_packet_end(struct vs_writer *w, size_t *len);

/* As vs_packet_open, after vs_packet_session has found no fault with the frame. */
int vs_packet_open_framed(const uint8_t *buf, size_t len, const uint8_t *key,
                          struct vs_header *header, const uint8_t **body, size_t *body_len);

#endif
