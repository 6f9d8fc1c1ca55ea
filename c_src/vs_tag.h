/* SPDX-License-Identifier: MIT */
/*
 * vs_tag.h - who may have made a packet: Chaskey-12 with its whole result of 128 bits, and the
 * keys of a session. Source: N. Mouha, B. Mennink, A. Van Herrewege, D. Watanabe, B. Preneel,
 * I. Verbauwhede, "Chaskey: an efficient MAC algorithm for 32-bit microcontrollers" (2014), its
 * status update (2015) for the 12 rounds, and ISO/IEC 29192-6. Pure.
 *
 * A robot's own key is the root of its sessions' keys; who has none uses vs_key_published, which
 * detects damage and proves nothing. A packet begins with 'V', what keys are made of does not.
 */
#ifndef VS_TAG_H
#define VS_TAG_H

#include <stddef.h>
#include <stdint.h>

#define VS_KEY_SIZE 16
#define VS_TAG_SIZE 16

/* The root of those that have no key. */
extern const uint8_t vs_key_published[VS_KEY_SIZE];

/* The tag of len bytes under a key. A third dearer where data is not at a word's address. */
void vs_tag_make(const uint8_t key[VS_KEY_SIZE], const uint8_t *data, size_t len,
                 uint8_t tag[VS_TAG_SIZE]);

/* What answers a HELLO is tagged with: nobody else's greeting can be answered with it. */
void vs_key_answer(const uint8_t root[VS_KEY_SIZE], const uint8_t hello_tag[VS_TAG_SIZE],
                   uint8_t key[VS_KEY_SIZE]);

/* The two keys of a session: what goes down to the robot, and up to the host. The tags of HELLO
 * and WELCOME stand for all of both, nonces and session number included. */
void vs_key_session(const uint8_t root[VS_KEY_SIZE], const uint8_t hello_tag[VS_TAG_SIZE],
                    const uint8_t welcome_tag[VS_TAG_SIZE], uint8_t down[VS_KEY_SIZE],
                    uint8_t up[VS_KEY_SIZE]);

#endif
