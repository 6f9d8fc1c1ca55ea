/* SPDX-License-Identifier: MIT */
/*
 * uid.h - who this board is, from what it has: the first of these that it knows.
 *
 *   /etc/machine-id             systemd writes it at the first start
 *   /var/lib/dbus/machine-id    D-Bus does, on boards without systemd
 *   serial number               of the processor, in /proc/cpuinfo; all zeros is none
 *   MAC address                 the lowest that its maker gave to one of its networks
 *
 * Cards that were copied have the same files, and two boards with such a card are told apart
 * by their tags alone.
 */
#ifndef VS_UID_H
#define VS_UID_H

#include "options.h"

/* What to do about a board that has none of all that: one line. */
extern const char vs_uid_missing[];

/* Gives the options a uid of this board and their tag, unless they have one. Returns where it
 * is from, one phrase, or NULL. */
const char *vs_uid_find(struct vs_options *options);

/* A uid in hexadecimal. */
void vs_uid_text(const uint8_t uid[VS_UID_SIZE], char text[2 * VS_UID_SIZE + 1]);

#endif
