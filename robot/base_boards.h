/* SPDX-License-Identifier: MIT */
/*
 * base_boards.h - the boards beside a base, each on an I2C bus that may be the base's
 * own, and each with a process of its own (board_process.h). One that does not answer is
 * left alone for a second. Pure.
 */
#ifndef VS_BASE_BOARDS_H
#define VS_BASE_BOARDS_H

#include "base_imu.h"
#include "../c_src/epuck_boards.h"
#include "../c_src/vs_i2c.h"

#define VS_BOARD_HEARD 8             /* messages that a reading holds */
#define VS_BOARD_REGISTERS 8         /* of one message heard */
#define VS_BOARD_REST_NS 1000000000u /* [ns] without a board that does not answer */
#define VS_BOARD_SAY_NS 100000000u   /* [ns] until the same message is said again */
#define VS_BOARD_READ_NS 30000000u   /* [ns] at a time, for all but range and bearing */
#define VS_BOARD_MEASURE_NS 1000000000u /* [ns] from one look at the battery to the next */
#define VS_BOARD_TALK_NS 24000000u   /* [ns] range and bearing at a time; 4 mostly */
#define VS_BOARD_TALKS 8             /* for a request at the most: its queue may never be empty */

enum {
    VS_BOARD_GROUND = 0,
    VS_BOARD_RAB = 1,
    VS_BOARD_BATTERY = 2,
    VS_BOARD_RGB = 3, /* IRIDIA's LEDs */
    VS_BOARD_IMU = 4,
    VS_BOARDS = 5
};

/* What the robot says to the others, again and again until it says something else. */
struct vs_board_message {
    uint8_t length; /* 0: nothing */
    uint8_t data[4];
};

/* What the robot wants of its boards. */
struct vs_board_request {
    struct vs_board_message message; /* for range and bearing */
    uint8_t rgb[EPUCK_RGB_LEDS][3];  /* for the RGB LEDs */
};

struct vs_board_reading {
    uint8_t there;        /* bit n: the robot has board n */
    uint8_t has[VS_BOARDS]; /* 1: what this board says is up to date, LEDs shine as told */
    uint8_t rab_bytes;    /* of a message heard */
    uint16_t battery_mv;  /* [mV] 0 = not known */
    float rab_k_cm;       /* [cm] this board's range = rab_k_cm * exp(9.0642 - 0.0056507 raw) */
    int16_t ground[3];    /* [raw] left, centre, right, higher is brighter */
    int16_t rates[3];     /* [1/EPUCK_IMU_DIGITS rad/s] x, y, z */
    uint32_t heard_count; /* messages heard since the start */
    struct epuck_rab_message heard[VS_BOARD_HEARD]; /* the n-th, from 0, is at n % 8 */
};

/* The caller fills bus (transfer NULL: no such board), reading.there, reading.rab_bytes (2 or
 * 4), reading.rab_k_cm and rab_power; all else is 0 at first. */
struct vs_boards {
    struct vs_i2c bus[VS_BOARDS];
    int fd[VS_BOARDS];       /* of buses that are not the base's */
    uint8_t silent;          /* bit n: board n does not answer */
    uint8_t settings;        /* range and bearing: how many settings were written */
    uint8_t rab_power;       /* EPUCK_RAB_POWER */
    uint8_t saying;          /* bytes of the message being written that are */
    struct vs_board_message message; /* being written, or said last */
    uint8_t listening;       /* 1: there may be more in its queue */
    uint8_t hearing;         /* 1: a message was taken, its registers are being read */
    uint8_t held_count;      /* registers read */
    uint8_t held[VS_BOARD_REGISTERS];
    uint64_t rest_ns[VS_BOARDS]; /* left alone until then */
    uint8_t measuring;       /* battery: 1 = a conversion was begun */
    uint64_t measured_ns;    /* battery: when the newest one was */
    struct vs_imu imu;
    uint64_t polled_ns;      /* range and bearing: the newest poll */
    uint64_t wrote_ns;       /* range and bearing: the newest message or setting */
    struct vs_board_reading reading;
};

/* Reads the ground sensors. No transaction begins that could end after deadline_ns. *news
 * becomes a phrase if the board falls silent or speaks again, else it is left alone. */
void vs_boards_read_ground(struct vs_boards *boards, uint64_t deadline_ns, const char **news);

/* Measures the battery, likewise: once a second, and in two calls. */
void vs_boards_read_battery(struct vs_boards *boards, uint64_t deadline_ns, const char **news);

/* Lets the RGB LEDs shine, likewise. */
void vs_boards_shine(struct vs_boards *boards, const uint8_t rgb[EPUCK_RGB_LEDS][3],
                     uint64_t deadline_ns, const char **news);

/* Reads the gyroscope, likewise. */
void vs_boards_read_imu(struct vs_boards *boards, uint64_t deadline_ns, const char **news);

/* Lets range and bearing say message, if it is time, and takes what was heard. What there is
 * no time for goes on with the next call: returns 1 if that is so, else 0. */
int vs_boards_talk(struct vs_boards *boards, const struct vs_board_message *message,
                   uint64_t deadline_ns, const char **news);

/* Does what a board's process does for a request, if the board is there. */
void vs_boards_ask(struct vs_boards *boards, int board, const struct vs_board_request *request,
                   uint64_t now_ns, const char **news);

/* Takes over what the process of one board measured. */
void vs_boards_take(struct vs_board_reading *all, const struct vs_board_reading *one, int board);

/* Nothing is known of a board now. */
void vs_boards_lose(struct vs_board_reading *all, int board);

/* 1 if every board on a bus answers and is ready. */
int vs_boards_are_well(const struct vs_boards *boards);

#endif
