/* SPDX-License-Identifier: MIT */
#include "vs_shown.h"

#include <string.h>

#include "vs_bytes.h"

int vs_shown_next(const uint8_t *block, size_t len, size_t *at, char *name,
                  uint8_t *kind, float *number, char *text)
{
    struct vs_reader r;
    const uint8_t *f4;

    if (*at == len)
        return VS_ERR_NOT_FOUND;
    vs_reader_init(&r, block, len);
    r.pos = *at;
    vs_get_text(&r, name, VS_SHOWN_NAME_MAX);
    *kind = vs_get_u8(&r);
    *number = 0.0f;
    text[0] = '\0';
    if (*kind == VS_SHOWN_NUMBER) {
        f4 = vs_get_bytes(&r, 4);
        *number = f4 != NULL ? vs_load_f4(f4) : 0.0f;
    } else {
        vs_get_text(&r, text, VS_SHOWN_TEXT_MAX);
    }
    if (r.error != VS_OK)
        return r.error;
    if (*kind > VS_SHOWN_TEXT || name[0] == '\0')
        return VS_ERR_BODY;
    *at = r.pos;
    return VS_OK;
}

/* Offset of the named item in a valid block, or len; *size is its bytes. */
static size_t find(const uint8_t *block, size_t len, const char *name, size_t name_len,
                   size_t *size)
{
    size_t at = 0;

    for (*size = 0; at < len; at += *size) {
        const uint8_t *kind = block + at + 1 + block[at];

        *size = 2 + (size_t)block[at] + (*kind == VS_SHOWN_NUMBER ? 4 : 1 + (size_t)kind[1]);
        if (block[at] == name_len && memcmp(block + at + 1, name, name_len) == 0)
            return at;
    }
    *size = 0;
    return len;
}

int vs_shown_set(uint8_t *block, uint8_t *len, const char *name, float number, const char *text)
{
    uint8_t item[2 + VS_SHOWN_NAME_MAX + 1 + VS_SHOWN_TEXT_MAX];
    size_t name_len = strlen(name);
    struct vs_writer w;
    size_t size;
    size_t at;

    vs_writer_init(&w, item, sizeof item);
    vs_put_text(&w, name, VS_SHOWN_NAME_MAX);
    vs_put_u8(&w, text == NULL ? VS_SHOWN_NUMBER : VS_SHOWN_TEXT);
    if (text != NULL) {
        vs_put_text(&w, text, VS_SHOWN_TEXT_MAX);
    } else if (w.error == VS_OK) {
        vs_store_f4(item + w.len, number);
        w.len += 4;
    }
    if (w.error != VS_OK || name_len == 0)
        return VS_ERR_TEXT;
    at = find(block, *len, name, name_len, &size);
    if (*len - size + w.len > VS_SHOWN_MAX)
        return VS_ERR_SPACE;
    memmove(block + at + w.len, block + at + size, *len - at - size);
    memcpy(block + at, item, w.len);
    *len = (uint8_t)(*len - size + w.len);
    return VS_OK;
}
