/* SPDX-License-Identifier: MIT */
/* wifi_line.h - a base's line that is a TCP connection: opened, looked at, ended for everybody. */
#ifndef VS_WIFI_LINE_H
#define VS_WIFI_LINE_H

#include "../c_src/vs_io.h"

/* Begins a connection. VS_OK and the descriptor in *fd, or VS_ERR_IO with errno set. */
int vs_wifi_line_open(const uint8_t address[4], uint16_t port, int *fd);

/* VS_OK: it is there, VS_ERR_BUSY: not until deadline_ns, VS_ERR_IO with errno set: it will not be. */
int vs_wifi_line_await(int fd, uint64_t deadline_ns);

/* Ends the connection, also for another process that has it, and forgets it. */
void vs_wifi_line_close(int *fd);

/* [byte] that were written and that the far end has not acknowledged; -1: not known. */
int vs_wifi_line_unheard(int fd);

/* Lets io work on *fd. *fd has to outlive io. */
void vs_wifi_line_io(struct vs_io *io, int *fd);

#endif
