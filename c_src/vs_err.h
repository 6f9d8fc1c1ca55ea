/* SPDX-License-Identifier: MIT */
/* vs_err.h - every error of libvsense: 0 or one of these negative codes. */
#ifndef VS_ERR_H
#define VS_ERR_H

enum vs_err {
    VS_OK = 0,

    /* 1..9: the caller's buffers and arguments */
    VS_ERR_SHORT = -1,     /* the packet is not complete: more bytes are needed */
    VS_ERR_SPACE = -2,     /* the output buffer or the packet's limit is too small */
    VS_ERR_ARGUMENT = -3,  /* an argument is outside its documented range */
    VS_ERR_STATE = -4,     /* not possible now (e.g. the session is not open) */

    /* 10..19: the frame; on TCP the stream is lost, on UDP the datagram */
    VS_ERR_MAGIC = -10,    /* does not start with "VS" */
    VS_ERR_VERSION = -11,  /* another protocol version */
    VS_ERR_TYPE = -12,     /* unknown packet type, or one that is not expected here */
    VS_ERR_LENGTH = -13,   /* length field outside the type's limits, or bytes left over */
    VS_ERR_TAG = -14,      /* the tag does not match: damaged, or made with another key */

    /* 20..29: the body */
    VS_ERR_BODY = -20,     /* a field is outside its range, or the size is wrong */
    VS_ERR_TEXT = -21,     /* text too long, not UTF-8, or with control characters */
    VS_ERR_LAYOUT = -22,   /* layout is not "[count*]type", or disagrees with size */
    VS_ERR_DUPLICATE = -23,/* two entries of the table share an id or a name */
    VS_ERR_TABLE_SIZE = -24, /* more entries or bytes than fit one datagram */
    VS_ERR_NOT_FOUND = -25,  /* no entry of that name or index */

    /* 30..39: the acceptance filter */
    VS_ERR_SESSION = -30,  /* packet of another session */
    VS_ERR_TABLE = -31,    /* packet of another sensor table */
    VS_ERR_RUN = -32,      /* packet of an earlier run */
    VS_ERR_OLDER = -33,    /* sequence older than the newest accepted */
    VS_ERR_REPEATED = -34, /* sequence equal to the newest accepted */
    VS_ERR_JUMP = -36,     /* sequence or run too far ahead to be true */
    VS_ERR_SEQUENCE = -35, /* no sequence number left: the session must be renewed */

    /* 40..49: the robot's base and the line to it */
    VS_ERR_IO = -40,     /* the device failed */
    VS_ERR_HANGUP = -41, /* the device is gone */
    VS_ERR_LOCKED = -42, /* another process holds the device */
    VS_ERR_SILENT = -43, /* the base does not answer */
    VS_ERR_GARBLED = -44,/* the answer is none that a base gives */
    VS_ERR_LATE = -45,   /* the command is written, its answer still on the way */
    VS_ERR_BUSY = -46    /* nothing was written: an earlier answer is on the way */
};

/* One line of plain English for a code; never NULL, static storage. */
const char *vs_strerror(int err);

/* The code's name, "VS_ERR_SHORT"; "VS_ERR_?" for a number that is none. */
const char *vs_errname(int err);

#endif
