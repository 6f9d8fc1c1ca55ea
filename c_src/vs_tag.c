/* SPDX-License-Identifier: MIT */
#include "vs_tag.h"

#include <string.h>

#include "vs_bytes.h"

/* What a key is made for: the first byte of what it is made of. */
enum purpose { FOR_ANSWER = 'A', FOR_DOWN = 'D', FOR_UP = 'U' };

const uint8_t vs_key_published[VS_KEY_SIZE] = {'v', 's', 'e', 'n', 's', 'e', ',', ' ',
                                               'i', 'n', 's', 'e', 'c', 'u', 'r', 'e'};

struct sip {
    uint64_t v0, v1, v2, v3;
};

static inline uint64_t rotate(uint64_t value, unsigned int bits)
{
    return value << bits | value >> (64 - bits);
}

static inline void sip_round(struct sip *s)
{
    s->v0 += s->v1;
    s->v1 = rotate(s->v1, 13) ^ s->v0;
    s->v0 = rotate(s->v0, 32);
    s->v2 += s->v3;
    s->v3 = rotate(s->v3, 16) ^ s->v2;
    s->v0 += s->v3;
    s->v3 = rotate(s->v3, 21) ^ s->v0;
    s->v2 += s->v1;
    s->v1 = rotate(s->v1, 17) ^ s->v2;
    s->v2 = rotate(s->v2, 32);
}

static inline void sip_word(struct sip *s, uint64_t word)
{
    s->v3 ^= word;
    sip_round(s);
    sip_round(s);
    s->v0 ^= word;
}

static uint64_t sip_end(struct sip *s)
{
    int i;

    for (i = 0; i < 4; i++)
        sip_round(s);
    return s->v0 ^ s->v1 ^ s->v2 ^ s->v3;
}

void vs_tag_make(const uint8_t key[VS_KEY_SIZE], const uint8_t *data, size_t len,
                 uint8_t tag[VS_TAG_SIZE])
{
    uint64_t k0 = vs_load_u64(key);
    uint64_t k1 = vs_load_u64(key + 8);
    struct sip s = {k0 ^ 0x736F6D6570736575, k1 ^ 0x646F72616E646F6D ^ 0xEE,
                    k0 ^ 0x6C7967656E657261, k1 ^ 0x7465646279746573};
    const uint8_t *end = data + (len & ~(size_t)7);
    uint8_t last[8] = {0};

    for (; data != end; data += 8)
        sip_word(&s, vs_load_u64(data));
    memcpy(last, data, len & 7);
    last[7] = (uint8_t)len;
    sip_word(&s, vs_load_u64(last));
    s.v2 ^= 0xEE;
    vs_store_u64(tag, sip_end(&s));
    s.v1 ^= 0xDD;
    vs_store_u64(tag + 8, sip_end(&s));
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
