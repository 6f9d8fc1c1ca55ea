/* SPDX-License-Identifier: MIT */
/*
 * vs_table.h - the sensor table: which virtual sensors (host -> robot), virtual
 * actuators and readings of the robot's own (robot -> host) a session carries, in
 * which order. Sent once in WELCOME; robots bind by name. Bounded, owned by the caller.
 */
#ifndef VS_TABLE_H
#define VS_TABLE_H

#include <stddef.h>
#include <stdint.h>

#include "vs_err.h"
#ifdef VS_SMALL
#include "vs_small.h"
#endif

#define VS_NAME_MAX 31       /* [byte] names and layouts, without the final zero */

#ifndef VS_SMALL
#define VS_TABLE_MAX 32      /* entries */
#define VS_TABLE_BYTES 2177  /* [byte] largest encoded table: 1 + 32 * 68 */

/* Room for payloads in one datagram of 1200 bytes, after its fixed part. */
#define VS_SENSOR_BYTES 1112  /* STATE: sum over sensors of 4 + size */
#define VS_ACTUATOR_BYTES 683 /* TELEMETRY: sum over actuators of size, over readings of 4 + size */
#endif

enum vs_direction {
    VS_SENSOR = 0,   /* host -> robot, in STATE: a payload and its age */
    VS_ACTUATOR = 1, /* robot -> host, in TELEMETRY: a payload */
    VS_READING = 2   /* robot -> host, in TELEMETRY: a payload and its age */
};

struct vs_entry {
    uint8_t id;        /* unique in the table */
    uint8_t direction; /* enum vs_direction */
    uint16_t size;     /* [byte] of the payload, 1.. */
    uint16_t count;    /* items in the payload, from layout */
    uint8_t type[2];   /* 'u' '1', 'i' '2', 'u' '2', 'i' '4', 'u' '4' or 'f' '4' */
    uint16_t rank;     /* 0.. among the entries that go its way, down or up */
    uint16_t offset;   /* [byte] of its payload in the block of those; a reading's age stands
                        * in the four bytes before it */
    char name[VS_NAME_MAX + 1];   /* UTF-8, not empty, unique in the table */
    char layout[VS_NAME_MAX + 1]; /* "f4", "8*f4", "3*u1": [count*]type */
};

struct vs_table {
    uint32_t count;          /* entries in use */
    uint32_t sensors;        /* of which sensors */
    uint32_t actuators;      /* of which actuators and readings */
    uint32_t readings;       /* of which readings */
    uint32_t sensor_bytes;   /* [byte] of the sensors' payload block */
    uint32_t actuator_bytes; /* [byte] of the block of what goes up, ages of readings included */
    uint32_t hash;           /* CRC-32 of the encoded table, kept up to date */
    struct vs_entry entries[VS_TABLE_MAX];
};

/* Makes the table empty. */
void vs_table_init(struct vs_table *t);

/*
 * Appends an entry; its size follows from layout. Errors: VS_ERR_ARGUMENT
 * (direction), VS_ERR_TEXT (name), VS_ERR_LAYOUT, VS_ERR_DUPLICATE,
 * VS_ERR_TABLE_SIZE; the table is then as before.
 */
int vs_table_add(struct vs_table *t, uint8_t id, uint8_t direction,
                 const char *name, const char *layout);

/* Writes the table's bytes to buf. Errors: VS_ERR_SPACE; *len is then 0. */
int vs_table_encode(const struct vs_table *t, uint8_t *buf, size_t cap, size_t *len);

/*
 * Reads a table from exactly len bytes. Errors: VS_ERR_BODY and those of
 * vs_table_add; the table is then empty.
 */
int vs_table_decode(struct vs_table *t, const uint8_t *buf, size_t len);

/* Index of the entry of that name, or VS_ERR_NOT_FOUND. */
int vs_table_find(const struct vs_table *t, const char *name);

#endif
