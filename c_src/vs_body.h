/* SPDX-License-Identifier: MIT */
/*
 * vs_body.h - what each packet says (PROTOCOL.md). vs_encode_* writes a whole packet and sets its
 * type and length itself; vs_decode_* reads the body that vs_packet_open found and leaves its output
 * alone on error, but for WELCOME's table (then empty): VS_ERR_SPACE (encode), _BODY, _TEXT.
 */
#ifndef VS_BODY_H
#define VS_BODY_H

#include "vs_shown.h"
#include "vs_table.h"
#include "vs_wire.h"

#define VS_UID_SIZE 16
#define VS_TEXT_MAX 200          /* [byte] reasons in REFUSE and GOODBYE */
#define VS_NONCE_SIZE 16
#define VS_PARAMS_MAX 4096       /* [byte] controller's parameters in WELCOME */
#define VS_LOG_MAX 120           /* [byte] one line that a controller logs */
#define VS_STATE_FIXED 16        /* [byte] of STATE's body before the readings */
#define VS_TELEMETRY_FIXED 68    /* [byte] of TELEMETRY's body before what the table says */
#define VS_NEVER_US 0xFFFFFFFF   /* older_us of a value that was never measured */
#define VS_UNKNOWN 255           /* a yes or no that is not known */
#define VS_CAPABLE_KEYED 1       /* it has a key, and obeys only a host that has it, too */
#define VS_CAPABLE_HOME 2        /* it can drive home */

enum vs_run_state { VS_IDLE = 0, VS_RUN = 1, VS_PAUSE = 2, VS_STOP = 3, VS_HOME = 4 };
/* Why the robot's wheels are held at 0 (TELEMETRY); an unknown number is no error. */
enum vs_stop_cause {
    VS_CAUSE_NONE = 0,       /* not held */
    VS_CAUSE_WANTED = 1,     /* the host wants no run, or not yet */
    VS_CAUSE_NO_SESSION = 2, /* not connected */
    VS_CAUSE_STALE = 3,      /* no fresh state: the command expired */
    VS_CAUSE_NO_BEAT = 4,    /* no completed control step */
    VS_CAUSE_BASE = 5,       /* the base does not answer */
    VS_CAUSE_GUARD = 6,      /* the guard was silent */
    VS_CAUSE_SIGNAL = 7,     /* the daemon was told to end */
    VS_CAUSE_BATTERY = 8     /* the battery is empty */
};
enum vs_refuse_code {
    VS_REFUSE_TAG_IN_USE = 1,  /* another robot with this tag was just heard */
    VS_REFUSE_TAG_UNKNOWN = 2, /* no entity of the experiment has this tag */
    VS_REFUSE_FULL = 3,        /* no room for another robot */
    VS_REFUSE_HELLO = 4,       /* the greeting cannot be understood */
    VS_REFUSE_ROOM = 5,        /* the robot has no room for the parameters or the table */
    VS_REFUSE_CONTROLLER = 6,  /* it runs another controller than its table is for */
    VS_REFUSE_KEY = 7          /* it has no key, or another than the host's */
};

enum vs_goodbye_cause {
    VS_BYE_END = 0,       /* orderly end: program or experiment */
    VS_BYE_TAKEN_OVER = 1,/* the same robot opened a newer session */
    VS_BYE_SILENT = 2,    /* nothing was heard for too long */
    VS_BYE_RENEW = 3,     /* sequence numbers are used up, or out of order: greet again */
    VS_BYE_PROTOCOL = 4,  /* the peer broke the protocol */
    VS_BYE_BASE = 5       /* the robot's base is gone, or nothing can guard it */
};

struct vs_hello {
    uint8_t uid[VS_UID_SIZE];         /* who the robot is, for good */
    uint8_t nonce[VS_NONCE_SIZE];     /* random, of this connection */
    uint64_t started;                 /* random, of this start of the daemon */
    uint32_t uptime_s;                /* [s] since the board started */
    uint16_t tag;                     /* marker on its back */
    uint16_t capabilities;            /* VS_CAPABLE_...; unknown bits are ignored */
    uint16_t params_room;             /* [byte] of params that the robot can hold */
    uint16_t entries_room;            /* entries of a table likewise */
    uint16_t datagram_room;           /* [byte] of a STATE and a TELEMETRY likewise */
    char name[VS_NAME_MAX + 1];       /* for people */
    char controller[VS_NAME_MAX + 1]; /* for people */
    char version[VS_NAME_MAX + 1];    /* of the robot's software */
    char hash[VS_NAME_MAX + 1];       /* of the controller's source; empty if unknown */
};

struct vs_welcome {
    uint8_t nonce[VS_NONCE_SIZE]; /* the host's */
    uint32_t timestep_us; /* [us] 1.. */
    uint32_t seed;        /* of this robot's controller */
    uint16_t params_len;  /* [byte] */
    const char *params;   /* lines "key=value\n", UTF-8, without a final zero; decoded: into body */
    struct vs_table table;
};

struct vs_notice {
    uint16_t code; /* of REFUSE enum vs_refuse_code, of GOODBYE enum vs_goodbye_cause, <= 255 */
    char text[VS_TEXT_MAX + 1]; /* one line for people */
};

struct vs_state {
    uint8_t wanted;         /* enum vs_run_state, as of the host */
    int16_t goal_heading;   /* [1e-4 rad] with VS_HOME: to turn by, at the goal; else 0 */
    uint32_t from_timestep; /* VS_RUN counts when header.timestep >= from_timestep */
    uint32_t log_heard;     /* log line up to which the host has heard them, 0 = none */
    int16_t goal_x_mm;      /* [mm] with VS_HOME: ahead of the robot; else 0 */
    int16_t goal_y_mm;      /* [mm] to its left */
    uint32_t older_us[VS_TABLE_MAX];  /* [us] by rank: captured so long before capture_ns */
    uint8_t payload[VS_SENSOR_BYTES]; /* sensors' block: entry.offset, entry.size */
};

struct vs_telemetry {
    uint8_t state;         /* enum vs_run_state, what the robot does */
    uint8_t wanted;        /* enum vs_run_state, echo */
    uint8_t stop_cause;    /* enum vs_stop_cause */
    uint8_t battery_low;   /* 0, 1 or VS_UNKNOWN */
    uint32_t wanted_run;   /* echo: run that wanted belongs to */
    uint32_t control_step; /* control steps completed since the daemon started */
    int16_t left_steps_s;  /* [step/s] commanded after safety */
    int16_t right_steps_s; /* [step/s] */
    uint16_t leds;         /* bits 0-7 ring, 8 body, 9 front */
    uint16_t battery_mv;   /* [mV] 0 = unknown */
    uint32_t received;     /* STATE packets since the daemon started */
    uint32_t old;          /* of which older or repeated */
    uint32_t foreign;      /* of which of another session, run or table */
    uint32_t corrupt;      /* of which damaged or malformed */
    uint32_t base_errors;
    uint32_t guard_restarts;
    uint32_t clock_bound_us; /* [us] bound of the clock estimate, VS_NEVER_US = none */
    int8_t signal_dbm;     /* [dBm] of the host's access point, 0 = unknown */
    uint8_t power_saving;  /* of the radio: 0, 1 or VS_UNKNOWN */
    uint16_t bit_rate;     /* [100 kbit/s] of the radio, 0 = unknown */
    uint32_t retries;      /* frames that the radio gave up, VS_NEVER_US = unknown */
    uint32_t overruns;     /* control steps that began late (PROTOCOL.md) since the start */
    uint32_t base_resets;  /* resets of the microcontroller since the daemon started */
    uint32_t log_number;   /* of log, 1.. since the daemon started; 0 = no line */
    uint8_t payload[VS_ACTUATOR_BYTES]; /* what goes up; with readings u32 older [us] than send_ns */
    char log[VS_LOG_MAX + 1];    /* the oldest line that the host has not heard */
    uint8_t shown_len;           /* [byte] */
    uint8_t shown[VS_SHOWN_MAX]; /* vs_shown.h */
};

int vs_encode_hello(const struct vs_header *header, const struct vs_hello *hello,
                    uint8_t *buf, size_t cap, size_t *len);
int vs_decode_hello(const uint8_t *body, size_t len, struct vs_hello *hello);
int vs_encode_welcome(const struct vs_header *header, const struct vs_welcome *welcome,
                      uint8_t *buf, size_t cap, size_t *len);
int vs_decode_welcome(const uint8_t *body, size_t len, struct vs_welcome *welcome);
/* VS_REFUSE or VS_GOODBYE, as header->type says. */
int vs_encode_notice(const struct vs_header *header, const struct vs_notice *notice,
                     uint8_t *buf, size_t cap, size_t *len);
int vs_decode_notice(uint8_t type, const uint8_t *body, size_t len, struct vs_notice *notice);
int vs_encode_state(const struct vs_header *header, const struct vs_table *table,
                    const struct vs_state *state, uint8_t *buf, size_t cap, size_t *len);
int vs_decode_state(const struct vs_table *table, const uint8_t *body, size_t len,
                    struct vs_state *state);
int vs_encode_telemetry(const struct vs_header *header, const struct vs_table *table,
                        const struct vs_telemetry *telemetry,
                        uint8_t *buf, size_t cap, size_t *len);
int vs_decode_telemetry(const struct vs_table *table, const uint8_t *body, size_t len,
                        struct vs_telemetry *telemetry);

#endif
