/* SPDX-License-Identifier: MIT */
#include "vs_err.h"

#include <stddef.h>

static const struct {
    int err;
    const char *name;
    const char *text;
} errors[] = {
    {VS_OK, "VS_OK", "no error"},
    {VS_ERR_SHORT, "VS_ERR_SHORT", "the packet is not complete: more bytes are needed"},
    {VS_ERR_SPACE, "VS_ERR_SPACE", "the packet does not fit its buffer or its limit"},
    {VS_ERR_ARGUMENT, "VS_ERR_ARGUMENT", "an argument is outside its range"},
    {VS_ERR_STATE, "VS_ERR_STATE", "not possible in the present state"},
    {VS_ERR_MAGIC, "VS_ERR_MAGIC", "not a vsense packet: it does not start with \"VS\""},
    {VS_ERR_VERSION, "VS_ERR_VERSION", "the peer speaks another protocol version"},
    {VS_ERR_TYPE, "VS_ERR_TYPE", "packet type is unknown or not expected here"},
    {VS_ERR_LENGTH, "VS_ERR_LENGTH", "packet length is outside the limits of its type"},
    {VS_ERR_TAG, "VS_ERR_TAG", "tag does not match: the packet is damaged, or of another key"},
    {VS_ERR_BODY, "VS_ERR_BODY", "a field of the body is outside its range, or its size is wrong"},
    {VS_ERR_TEXT, "VS_ERR_TEXT", "text is too long, not UTF-8, or has control characters"},
    {VS_ERR_LAYOUT, "VS_ERR_LAYOUT", "layout is not [count*]type with type u1 i2 u2 i4 u4 f4, "
                                     "or disagrees with the size"},
    {VS_ERR_DUPLICATE, "VS_ERR_DUPLICATE", "two table entries share an id or a name"},
    {VS_ERR_TABLE_SIZE, "VS_ERR_TABLE_SIZE", "the table holds more than fits one datagram"},
    {VS_ERR_NOT_FOUND, "VS_ERR_NOT_FOUND", "the table has no such entry"},
    {VS_ERR_SESSION, "VS_ERR_SESSION", "packet of another session"},
    {VS_ERR_TABLE, "VS_ERR_TABLE", "packet of another sensor table"},
    {VS_ERR_RUN, "VS_ERR_RUN", "packet of an earlier run"},
    {VS_ERR_OLDER, "VS_ERR_OLDER", "packet is older than the newest accepted one"},
    {VS_ERR_REPEATED, "VS_ERR_REPEATED", "packet repeats the newest accepted one"},
    {VS_ERR_JUMP, "VS_ERR_JUMP", "sequence or run is too far ahead to be true"},
    {VS_ERR_SEQUENCE, "VS_ERR_SEQUENCE", "sequence numbers are used up: renew the session"},
    {VS_ERR_IO, "VS_ERR_IO", "the device failed"},
    {VS_ERR_HANGUP, "VS_ERR_HANGUP", "the device is gone"},
    {VS_ERR_LOCKED, "VS_ERR_LOCKED", "another process holds the device"},
    {VS_ERR_SILENT, "VS_ERR_SILENT", "the base does not answer"},
    {VS_ERR_GARBLED, "VS_ERR_GARBLED", "the base's answer makes no sense"},
    {VS_ERR_LATE, "VS_ERR_LATE", "the base's answer is late"},
    {VS_ERR_BUSY, "VS_ERR_BUSY", "the base still owes an earlier answer"},
};

#define COUNT (sizeof errors / sizeof errors[0])

static size_t find(int err)
{
    size_t i = 0;

    while (i < COUNT && errors[i].err != err)
        i++;
    return i;
}

const char *vs_strerror(int err)
{
    size_t i = find(err);

    return i < COUNT ? errors[i].text : "unknown error";
}

const char *vs_errname(int err)
{
    size_t i = find(err);

    return i < COUNT ? errors[i].name : "VS_ERR_?";
}
