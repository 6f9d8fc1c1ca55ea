/* SPDX-License-Identifier: MIT */
/*
 * vs_small.h - what a build with -DVS_SMALL has room for: a microcontroller's, where the
 * defaults of vs_table.h, vs_wire.h and vs_session.h would not fit. HELLO tells the host, which
 * refuses an experiment that needs more and says by how much. Each may be set to another number
 * by -D; all files of a program need the same ones.
 */
#ifndef VS_SMALL_H
#define VS_SMALL_H

#ifndef VS_TABLE_MAX
#define VS_TABLE_MAX 8
#endif
#ifndef VS_PARAMS_ROOM
#define VS_PARAMS_ROOM 64
#endif
#ifndef VS_DATAGRAM_MAX
#define VS_DATAGRAM_MAX 512
#endif
#if VS_DATAGRAM_MAX < 512 || VS_DATAGRAM_MAX > 1200
#error "VS_DATAGRAM_MAX: 512 (a greeting has to fit) to 1200"
#endif

#define VS_TABLE_BYTES (1 + VS_TABLE_MAX * 68)
#if 100 + VS_PARAMS_ROOM + VS_TABLE_BYTES < VS_DATAGRAM_MAX
#error "the largest WELCOME has to be as long as a datagram: more VS_TABLE_MAX or VS_PARAMS_ROOM"
#endif

#define VS_SENSOR_BYTES (VS_DATAGRAM_MAX - 88)    /* what STATE leaves */
#define VS_ACTUATOR_BYTES (VS_DATAGRAM_MAX - 142) /* what TELEMETRY with log and shown empty leaves */

#endif
