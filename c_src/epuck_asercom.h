/* SPDX-License-Identifier: MIT */
/*
 * epuck_asercom.h - GCtronic's advanced sercom, the UART protocol of the e-puck's
 * standard firmware. Both ends use it: the daemon's base and the microcontroller's
 * end in firmware_bridge/.
 *
 * 8N1. A binary packet is {code [payload]}* 0x00, code = 256 - letter. Commands act as
 * they are parsed; all answers come together after the 0x00, without lengths, codes or
 * checksum, and none at all if nothing was asked. Nothing but 'V' of the ASCII mode is
 * used beside it. Numbers are little-endian. There is no time-out anywhere.
 * Source: gctronic/e-puck-library program/DemoGCtronic-complete/Asercom.c and
 * main_c.c, commit 4cb85cb; e-puck2_main-processor src/epuck1x/Asercom2.c:612-621, 822-839,
 * 874-889, src/main.c:214-218, 541-545, commit d2e0dbb. Read, not tried on hardware.
 */
#ifndef EPUCK_ASERCOM_H
#define EPUCK_ASERCOM_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    EPUCK_ASERCOM_BATTERY = 0x9E,   /* 'b': 2 bytes */
    EPUCK_ASERCOM_SPEED = 0xBC,     /* 'D' left i16, right i16 [step/s], clamped to +-1000 */
    EPUCK_ASERCOM_COMMANDED = 0xBB, /* 'E': left, right as the last 'D' said */
    EPUCK_ASERCOM_LED = 0xB4,       /* 'L' number, state: 0-7 ring, 8 body, 9 front; 0, 1 */
    EPUCK_ASERCOM_GROUND = 0xB3,    /* 'M': 3 ground and 2 cliff values u16 */
    EPUCK_ASERCOM_PROX = 0xB2,      /* 'N': 8 or 10 values i16, calibrated, higher is nearer */
    EPUCK_ASERCOM_LIGHT = 0xB1,     /* 'O': 8 or 10 values u16, higher is darker */
    EPUCK_ASERCOM_STEPS = 0xAF,     /* 'Q': left, right counters u16, they wrap */
    EPUCK_ASERCOM_GYRO = 0x99,      /* 'g': x, y, z i16, 250 degrees a second are 32768 */
    EPUCK_ASERCOM_DISTANCE = 0xF3,  /* 0x0D, e-puck2 only: u16 [mm] */
    EPUCK_ASERCOM_LEDS = 10,        /* LEDs 0..9 */
    EPUCK_ASERCOM_RAW_MAX = 4095,   /* of proximity and light as they are given here */
    EPUCK_ASERCOM_REQUEST_MAX = 64, /* [byte] its receive ring has no overflow test */
    EPUCK_ASERCOM_REPLY_MAX = 64,   /* [byte] longest answer to a poll */
    EPUCK_ASERCOM_NO_GROUND = 6     /* [byte] answer to 'M', built without ground sensors */
};

/* What the two links, and so the daemon's modes, differ in. */
struct epuck_asercom_mode {
    uint32_t baud;
    uint8_t ring;   /* [byte] answer to 'N' and to 'O' */
    uint8_t ground; /* [byte] answer to 'M', which is asked for if it is not 0 */
    uint8_t epuck2; /* [byte] answers to 'g' and 0x0D, likewise */
    uint16_t leds;  /* those that 'L' acts on, as bits 0-7 ring, 8 body, 9 front */
};

enum {
    EPUCK_ASERCOM_EXTENSION = 0,        /* selector 10: UART2 of the extension connector */
    EPUCK_ASERCOM_BLUETOOTH = 1,        /* selector 3: UART1 */
    EPUCK_ASERCOM_BLUETOOTH_GROUND = 2, /* with the ground sensor extension */
    EPUCK_ASERCOM_EPUCK2 = 3,           /* an e-puck2's: selector 3 Bluetooth, 8 USB */
    EPUCK_ASERCOM_EPUCK2_GROUND = 4,    /* the same; one cliff value in place of two */
    EPUCK_ASERCOM_MODES = 5
};

extern const struct epuck_asercom_mode epuck_asercom_modes[EPUCK_ASERCOM_MODES];

/* Brings the parser from any state back to idle, where it then answers with its version:
 * zeros end a packet, a carriage return ends a line. 36 of them, because the longest
 * payload ('w') has 35. Never CR LF: a stray LF would swallow the next binary byte. */
#define EPUCK_ASERCOM_RESYNC_LEN 39
extern const uint8_t epuck_asercom_resync[EPUCK_ASERCOM_RESYNC_LEN];

/* How the answer to 'V' begins; one more line may follow. */
#define EPUCK_ASERCOM_VERSION "v,Version"

/* A poll: sets speeds and the LEDs in `change`, asks for all sensors, and last for the
 * commanded speeds, which proves that the packet was understood. */
struct epuck_asercom_poll {
    int16_t left_steps_s;
    int16_t right_steps_s;
    uint16_t leds;   /* lit ones */
    uint16_t change; /* LEDs that are to be set */
};

/* What it answers. */
struct epuck_asercom_sensors {
    int16_t prox[8];       /* ps0..ps7 */
    int16_t light[8];      /* ps0..ps7, higher is darker */
    uint16_t steps[2];     /* left, right */
    uint16_t battery;      /* raw, see epuck_asercom_battery_mv */
    int16_t ground[3];     /* left, centre, right; 0 unless the mode has them */
    int16_t rates[3];      /* x, y, z; 0 unless the mode has them */
    uint16_t distance_mm;  /* 0: not measured yet; likewise */
    int16_t left_steps_s;  /* commanded */
    int16_t right_steps_s; /* commanded */
};

/* Writes a poll. Returns its length. */
size_t epuck_asercom_put_poll(const struct epuck_asercom_mode *mode,
                              const struct epuck_asercom_poll *poll,
                              uint8_t packet[EPUCK_ASERCOM_REQUEST_MAX]);

/* Length of the answer to a poll. */
size_t epuck_asercom_reply_len(const struct epuck_asercom_mode *mode);

/* Reads the answer to a poll, epuck_asercom_reply_len bytes. Returns 0, or -1 if no
 * e-puck measures that: a lost byte shifts all that follow. *sensors is then left alone. */
int epuck_asercom_get_reply(const struct epuck_asercom_mode *mode, const uint8_t *reply,
                            struct epuck_asercom_sensors *sensors);

/* [mV] of a raw battery value, 0 if it says only low or not: older hardware. An e-puck is
 * at about 4.2 V with 2560, at 3.4 V with 2070; an e-puck2's converter of 12 bits sees 3/5 of
 * the voltage, with 3 V as its most.
 * Source: e-puck-library 4cb85cb library/utility; e-puck2_main-processor d2e0dbb
 * src/sensors/battery_level.h:14-15, battery_level.c:15-20, 102. */
uint16_t epuck_asercom_battery_mv(uint16_t raw, int is_epuck2);

/* 1 if the battery is below about 3.4 V, else 0. */
uint8_t epuck_asercom_battery_low(uint16_t raw, int is_epuck2);

#ifdef __cplusplus
}
#endif

#endif
