/* SPDX-License-Identifier: MIT */
/*
 * vs_body.h - what each packet says (PROTOCOL.md). vs_encode_* writes a whole
 * packet and sets its type and length itself, whatever the header says; vs_decode_*
 * reads the body that vs_packet_open found and on error leaves its output as it
 * was. Errors of all: VS_ERR_SPACE (encode), VS_ERR_BODY, VS_ERR_TEXT.
 */
#ifndef VS_BODY_H
#define VS_BODY_H

#include "vs_table.h"
#include "vs_wire.h"

#define VS_UID_SIZE 16
#define VS_TEXT_MAX 200          /* [byte] reasons in REFUSE and GOODBYE */
#define VS_PARAMS_MAX 512        /* [byte] controller's parameters in WELCOME */
#define VS_NEVER_US 0xFFFFFFFF   /* older_us of a value that was never measured */
#define VS_BATTERY_UNKNOWN 255

/* Run state, wanted (STATE) and actual (TELEMETRY). */
enum vs_run_state { VS_IDLE = 0, VS_RUN = 1, VS_PAUSE = 2, VS_STOP = 3 };

/* Why the robot's wheels are held at 0 (TELEMETRY); an unknown number is no error. */
enum vs_stop_cause {
    VS_CAUSE_NONE = 0,       /* not held */
    VS_CAUSE_WANTED = 1,     /* the host wants no run, or not yet */
    VS_CAUSE_NO_SESSION = 2, /* not connected */
    VS_CAUSE_STALE = 3,      /* no fresh state: the command expired */
    VS_CAUSE_NO_BEAT = 4,    /* no completed control step */
    VS_CAUSE_BASE = 5,       /* the base does not answer */
    VS_CAUSE_GUARD = 6,      /* the guard was silent */
    VS_CAUSE_SIGNAL = 7      /* the daemon was told to end */
};

enum vs_refuse_code {
    VS_REFUSE_TAG_IN_USE = 1,  /* another robot with this tag was just heard */
    VS_REFUSE_TAG_UNKNOWN = 2, /* no entity of the experiment has this tag */
    VS_REFUSE_FULL = 3,        /* no room for another robot */
    VS_REFUSE_HELLO = 4        /* the greeting cannot be understood */
};

enum vs_goodbye_cause {
    VS_BYE_END = 0,       /* orderly end: program or experiment */
    VS_BYE_TAKEN_OVER = 1,/* the same robot opened a newer session */
    VS_BYE_SILENT = 2,    /* nothing was heard for too long */
    VS_BYE_RENEW = 3,     /* sequence numbers are used up: greet again */
    VS_BYE_PROTOCOL = 4,  /* the peer broke the protocol */
    VS_BYE_BASE = 5       /* the robot's base is gone, or nothing can guard it */
};

struct vs_hello {
    uint8_t uid[VS_UID_SIZE];         /* who the robot is, for good */
    uint64_t nonce;                   /* reserved for authentication */
    uint16_t tag;                     /* marker on its back */
    uint16_t capabilities;            /* none defined yet: 0 */
    char name[VS_NAME_MAX + 1];       /* for people */
    char controller[VS_NAME_MAX + 1]; /* for people */
    char version[VS_NAME_MAX + 1];    /* of the robot's software */
    char hash[VS_NAME_MAX + 1];       /* of the controller's source; empty if unknown */
};

struct vs_welcome {
    uint64_t nonce;       /* the host's; reserved for authentication */
    uint32_t timestep_us; /* [us] 1.. */
    uint32_t seed;        /* of this robot's controller */
    char params[VS_PARAMS_MAX + 1]; /* lines "key=value\n", UTF-8 */
    struct vs_table table;
};

/* REFUSE (code: enum vs_refuse_code) and GOODBYE (code: enum vs_goodbye_cause, <= 255). */
struct vs_notice {
    uint16_t code;
    char text[VS_TEXT_MAX + 1]; /* one line for people */
};

struct vs_state {
    uint8_t wanted;         /* enum vs_run_state */
    uint32_t from_timestep; /* the robot runs when wanted is VS_RUN and
                             * header.timestep >= from_timestep */
    uint32_t older_us[VS_TABLE_MAX];  /* [us] by rank: the value's capture is
                                       * header.capture_ns - 1000 * older_us */
    uint8_t payload[VS_SENSOR_BYTES]; /* sensors' block: entry.offset, entry.size */
};

struct vs_telemetry {
    uint8_t state;         /* enum vs_run_state, the actual one */
    uint8_t wanted;        /* enum vs_run_state, echo */
    uint8_t stop_cause;    /* enum vs_stop_cause */
    uint8_t battery_low;   /* 0, 1 or VS_BATTERY_UNKNOWN */
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
    uint8_t payload[VS_ACTUATOR_BYTES]; /* actuators' block; levels or cumulative
                                         * counters only, never bare events */
};

int vs_encode_hello(const struct vs_header *header, const struct vs_hello *hello,
                    uint8_t *buf, size_t cap, size_t *len);
int vs_decode_hello(const uint8_t *body, size_t len, struct vs_hello *hello);
int vs_encode_welcome(const struct vs_header *header, const struct vs_welcome *welcome,
                      uint8_t *buf, size_t cap, size_t *len);
int vs_decode_welcome(const uint8_t *body, size_t len, struct vs_welcome *welcome);

/* header->type says which: VS_REFUSE or VS_GOODBYE. */
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
