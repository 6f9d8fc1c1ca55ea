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

/* One block of a message, where words may lie. */
union block {
    uint32_t for_alignment;
    uint8_t bytes[BLOCK];
};

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
#if defined __GNUC__
    block = __builtin_assume_aligned(block, sizeof(uint32_t));
#endif
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

/* The last block, maybe none or a part of one: padded, and under a key of its own. */
static inline void end_block(union block *last, size_t len, uint32_t v[4], uint32_t k[4])
{
    int i;

    multiply(k);
    if (len < BLOCK) {
        last->bytes[len] = 1;
        memset(last->bytes + len + 1, 0, BLOCK - 1 - len);
        multiply(k);
    }
    for (i = 0; i < 4; i++)
        v[i] ^= k[i];
}

void vs_tag_make(const uint8_t key[VS_KEY_SIZE], const uint8_t *data, size_t len,
                 uint8_t tag[VS_TAG_SIZE])
{
    union block own; /* of what lies elsewhere than at a word's address */
    uint32_t v[4] = {0};
    uint32_t k[4];
    int i;

    memcpy(own.bytes, key, BLOCK);
    mix(v, own.bytes);
    memcpy(k, v, sizeof k);
    for (;;) {
        const uint8_t *block = data;
        int is_last = len <= BLOCK;

        if (is_last || ((uintptr_t)data & (sizeof(uint32_t) - 1)) != 0) {
            memcpy(own.bytes, data, is_last ? len : BLOCK);
            block = own.bytes;
        }
        if (is_last)
            end_block(&own, len, v, k);
        mix(v, block);
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
