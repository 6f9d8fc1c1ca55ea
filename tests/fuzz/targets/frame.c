/* SPDX-License-Identifier: MIT */
/*
 * Any bytes as packets, nothing repaired: where a packet ends is seen from its first bytes alone,
 * the same with every further one, and what is not tagged with the key is not opened.
 */
#include "../../../c_src/vs_body.h"
#include "fuzz.h"

static void check_framing(const uint8_t *data, size_t size)
{
    size_t whole = 0;
    size_t again = 0;
    int err = vs_packet_length(data, size, &whole);
    int first = vs_packet_length(data, size < VS_PREFIX_SIZE ? size : VS_PREFIX_SIZE, &again);

    CHECK(err == first);
    if (err == VS_OK)
        CHECK(whole == again && whole >= VS_PACKET_MIN && whole <= vs_packet_limit(data[3]));
    if (err != VS_OK && err != VS_ERR_SHORT)
        CHECK(vs_packet_length(data, size - (size == 1 ? 0 : 1), &again) != VS_OK);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct vs_header header;
    const uint8_t *body;
    size_t body_len;
    uint32_t session = 0;
    int named = vs_packet_session(data, size, &session);
    int err = vs_packet_open(data, size, NULL, &header, &body, &body_len);

    check_framing(data, size);
    CHECK(named == err || (named == VS_OK && err == VS_ERR_TAG));
    if (err == VS_OK) {
        CHECK(header.length == size && header.session == session);
        CHECK(body == data + VS_HEADER_SIZE && body_len + VS_PACKET_MIN == size);
        CHECK(vs_packet_open(data, size - 1, NULL, &header, &body, &body_len) != VS_OK);
    }
    return 0;
}
