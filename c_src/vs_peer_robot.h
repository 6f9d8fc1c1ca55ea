/* SPDX-License-Identifier: MIT */
/*
 * vs_peer_robot.h - the mirror images of vs_peer_send_state and vs_peer_receive_telemetry:
 * what only the robot's session calls of its host's vs_peer. Internal to libvsense.
 */
#ifndef VS_PEER_ROBOT_H
#define VS_PEER_ROBOT_H

#include "vs_peer.h"

int vs_peer_send_telemetry(struct vs_peer *p, const struct vs_table *table,
                           struct vs_header *header, const struct vs_telemetry *telemetry,
                           uint64_t now_ns, uint8_t *buf, size_t cap, size_t *len);

/* A packet that is dropped leaves *state as it was, but maybe its own header in *header. */
int vs_peer_receive_state(struct vs_peer *p, const struct vs_table *table, int via,
                          const uint8_t *buf, size_t len, uint64_t now_ns,
                          struct vs_header *header, struct vs_state *state);

#endif
