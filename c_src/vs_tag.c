/* SPDX-License-Identifier: MIT */
#include "vs_tag.h"

#include <string.h>

#include "vs_bytes.h"

/* What a key is made for: the first byte of what it is made of. */
enum purpose { FOR_ANSWER = 'A', FOR_DOWN = 'D', FOR_UP = 'U' };

const uint8_t vs_key_published[VS_KEY_SIZE] = {'v', 's', 'e', 'n', 's', 'e', ',', ' ',
                                               'i', 'n', 's', 'e', 'c', 'u', 'r', 'e'};

#define BLOCK 16   /* [byte] */
#define ROUNDS 12  /* Chaskey-12's */

static inline uint32_t rotate(uint32_t value, unsigned int bits)
{
    return value << bits | value >> (32 - bits);
}

static inline void permute_once(uint32_t v[4])
{
    v[0] += v[1];
    v[1] = rotate(v[1], 5) ^ v[0];
    v[0] = rotate(v[0], 16);
    v[2] += v[3];
    v[3] = rotate(v[3], 8) ^ v[2];
    v[0] += v[3];
    v[3] = rotate(v[3], 13) ^ v[0];
    v[2] += v[1];
    v[1] = rotate(v[1], 7) ^ v[2];
    v[2] = rotate(v[2], 16);
}

/* Four rounds at a time: the rotations by 16 then cost an ARM nothing. */
static inline void permute(uint32_t v[4])
{
    int i;

    for (i = 0; i < ROUNDS / 4; i++) {
        permute_once(v);
        permute_once(v);
        permute_once(v);
        permute_once(v);
    }
}

/* Mixes one block of words in. What lies at a word's address an ARM reads as words. */
static inline void mix(uint32_t v[4], const uint8_t *block)
{
    block = vs_aligned(block);
    v[0] ^= vs_load_u32(block);
    v[1] ^= vs_load_u32(block + 4);
    v[2] ^= vs_load_u32(block + 8);
    v[3] ^= vs_load_u32(block + 12);
}

/* Multiplies by x in the field of 2^128 elements, modulo x^128 + x^7 + x^2 + x + 1; takes the same
 * time for every value. */
static inline void multiply(uint32_t k[4])
{
    uint32_t over = (0 - (k[3] >> 31)) & 0x87;

    k[3] = k[3] << 1 | k[2] >> 31;
    k[2] = k[2] << 1 | k[1] >> 31;
    k[1] = k[1] << 1 | k[0] >> 31;
    k[0] = k[0] << 1 ^ over;
}

/* The key of the last block: k once doubled if that is whole, else twice. */
static inline void last_key(uint32_t v[4], uint32_t k[4], int is_whole)
{
    int i;

    multiply(k);
    if (!is_whole)
        multiply(k);
    for (i = 0; i < 4; i++)
        v[i] ^= k[i];
}

/* A block that lies elsewhere than at a word's address, or ends early: then it is padded. */
static inline const uint8_t *copied(union vs_words *own, const uint8_t *data, size_t len)
{
    memset(own->bytes, 0, BLOCK);
    own->bytes[len < BLOCK ? len : 0] = 1;
    memcpy(own->bytes, data, len < BLOCK ? len : BLOCK);
    return own->bytes;
}

void vs_tag_make(const uint8_t key[VS_KEY_SIZE], const uint8_t *data, size_t len,
                 uint8_t tag[VS_TAG_SIZE])
{
    int is_aligned = vs_is_aligned(data);
    union vs_words own;
    uint32_t v[4] = {0};
    uint32_t k[4];
    int i;

    mix(v, vs_is_aligned(key) ? key : copied(&own, key, BLOCK));
    for (i = 0; i < 4; i++)
        k[i] = v[i];
    for (;;) {
        int is_last = len <= BLOCK;

        if (is_last)
            last_key(v, k, len == BLOCK);
        mix(v, is_aligned && len >= BLOCK ? data : copied(&own, data, len));
        permute(v);
        if (is_last)
            break;
        data += BLOCK;
        len -= BLOCK;
    }
    for (i = 0; i < 4; i++)
        (void)vs_store_u32(tag + 4 * i, v[i] ^ k[i]);
}

void vs_key_answer(const uint8_t root[VS_KEY_SIZE], const uint8_t hello_tag[VS_TAG_SIZE],
                   uint8_t key[VS_KEY_SIZE])
{
    uint8_t made_of[1 + VS_TAG_SIZE];

    made_of[0] = FOR_ANSWER;
    memcpy(made_of + 1, hello_tag, VS_TAG_SIZE);
    vs_tag_make(root, made_of, sizeof made_of, key);
}

void vs_key_session(const uint8_t root[VS_KEY_SIZE], const uint8_t hello_tag[VS_TAG_SIZE],
                    const uint8_t welcome_tag[VS_TAG_SIZE], uint8_t down[VS_KEY_SIZE],
                    uint8_t up[VS_KEY_SIZE])
{
    uint8_t made_of[1 + 2 * VS_TAG_SIZE];

    memcpy(made_of + 1, hello_tag, VS_TAG_SIZE);
    memcpy(made_of + 1 + VS_TAG_SIZE, welcome_tag, VS_TAG_SIZE);
    made_of[0] = FOR_DOWN;
    vs_tag_make(root, made_of, sizeof made_of, down);
    made_of[0] = FOR_UP;
    vs_tag_make(root, made_of, sizeof made_of, up);
}
