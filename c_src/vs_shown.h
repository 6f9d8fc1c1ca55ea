/* SPDX-License-Identifier: MIT */
/*
 * vs_shown.h - the named values that a controller shows, as TELEMETRY carries them:
 * items one after the other, each u8 length and name, u8 kind, and an f4 or u8 length
 * and text. The robot keeps its values in this form; nothing else is allocated.
 */
#ifndef VS_SHOWN_H
#define VS_SHOWN_H

#include <stddef.h>
#include <stdint.h>

#include "vs_err.h"

#define VS_SHOWN_MAX 255      /* [byte] all items */
#define VS_SHOWN_NAME_MAX 15  /* [byte] without the final zero */
#define VS_SHOWN_TEXT_MAX 48  /* [byte] likewise */

enum vs_shown_kind { VS_SHOWN_NUMBER = 0, VS_SHOWN_TEXT = 1 };

/*
 * Sets one item of block[VS_SHOWN_MAX], of which *len bytes are in use; text NULL: the
 * number. Errors: VS_ERR_TEXT (name or text too long, empty name, no clean text),
 * VS_ERR_SPACE; the block is then as before.
 */
int vs_shown_set(uint8_t *block, uint8_t *len, const char *name, float number, const char *text);

/*
 * Reads the item at *at and moves *at behind it. name[VS_SHOWN_NAME_MAX + 1] and
 * text[VS_SHOWN_TEXT_MAX + 1] are zero-terminated; text is empty for a number.
 * VS_ERR_NOT_FOUND at the end; VS_ERR_BODY, VS_ERR_TEXT if the block is not valid.
 */
int vs_shown_next(const uint8_t *block, size_t len, size_t *at, char *name,
                  uint8_t *kind, float *number, char *text);

#endif
