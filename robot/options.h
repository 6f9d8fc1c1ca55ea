/* SPDX-License-Identifier: MIT */
/*
 * options.h - the daemon's command line and its settings file, read into a struct. Pure.
 * What the command line says wins over the file.
 */
#ifndef VS_OPTIONS_H
#define VS_OPTIONS_H

#include "base_config.h"
#include "calibration.h"
#include "settings.h"
#include "../c_src/vs_session.h"

#define VSENSED_VERSION "0.1.0"

/* The version, and behind a "+" the digest of the sources that the daemon was made of. */
extern const char vsensed_version[VS_NAME_MAX + 1];

/* Which source the controller was made of; empty: nobody said it. */
extern const char vsensed_controller_hash[VS_NAME_MAX + 1];

struct vs_options {
    const char *host;                 /* numeric IPv4 */
    uint16_t port;
    uint16_t tag;
    char name[VS_NAME_MAX + 1];       /* default robot_TAG */
    uint8_t uid[VS_UID_SIZE];
    const char *key_file;             /* NULL: none */
    uint8_t key[VS_KEY_SIZE];         /* of that file; key.h reads it */
    uint8_t keyed;
    uint8_t insecure;                 /* without a key, and content */
    uint8_t has_uid;
    uint8_t has_tag;
    uint8_t check;                    /* look whether all is well, and end */
    uint8_t wiggle;                   /* with it: turn the robot a little, too */
    uint8_t identify;                 /* print the uid, and end */
    char *const *argv;                /* the whole command line */
    struct vs_base_config base;
    const char *watchdog;             /* the board's, NULL: none */
    struct vs_calibration calibration;
    uint16_t battery_stop_mv;         /* [mV] 0: none */
    const char *trace;                /* NULL: none */
    int64_t clock_offset_ns;
    int64_t clock_drift_ppb;
#ifdef VSENSED_SLOW_CLOCK
    uint32_t clock_permille;          /* of the board's rate, 1000: as fast */
    const char *radio;                /* radio.h's file of a lab, NULL: none */
#endif
};

enum vs_options_result { VS_OPTIONS_RUN, VS_OPTIONS_HELP, VS_OPTIONS_VERSION, VS_OPTIONS_BAD };

/* All that is not given later has its default. */
void vs_options_init(struct vs_options *options);

/* The file that argv names with --config, NULL if it names none. */
const char *vs_options_config(int argc, char *const argv[]);

/* Takes over what a settings file says: the options' names without their dashes. Its
 * text is kept, not copied. 0, or -1 and why, which begins with file and line. */
int vs_options_read_settings(struct vs_options *options, const char *file,
                             struct vs_settings *settings, char *why, size_t why_size);

/* Reads argv[1..]. VS_OPTIONS_BAD: why is a line without its newline that says what
 * was expected and what came. The strings of argv are kept, not copied. */
enum vs_options_result vs_options_read(struct vs_options *options, int argc, char *const argv[],
                                       char *why, size_t why_size);

/* Makes a uid of 32 hexadecimal digits (the machine's id) and the tag. Returns 0, or
 * -1 if text does not begin with 32 digits. */
int vs_options_make_uid(struct vs_options *options, const char *text);

/* Help of all options; the bases are listed after it by name. */
extern const char vs_options_help[];

#endif
