/* SPDX-License-Identifier: MIT */
/*
 * The daemon's command line, its settings and key files, and the numbers in them. First byte: which.
 * Texts are separated by NUL. What is refused has a reason of one line; what is taken lies in its
 * documented range; a number is the one that the C library reads; a key never is in a reason.
 */
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "../../../c_src/vs_format.h"
#include "../../../robot/base_config.h"
#include "../../../robot/key.h"
#include "../../../robot/number.h"
#include "../../../robot/options.h"
#include "../../../robot/presets.h"
#include "fuzz.h"

#define WORDS 24
#define WHY 256

int memfd_create(const char *name, unsigned int flags);

static char text[VS_SETTINGS_MAX + 1];
static struct vs_options options;
static struct vs_settings settings;

/* The rest of the input as a text. */
static size_t take_text(struct input *in)
{
    size_t len = sizeof text - 1;
    const uint8_t *bytes = take_bytes(in, &len);

    if (len > 0)
        memcpy(text, bytes, len);
    text[len] = '\0';
    return len;
}

static void check_why(const char *why)
{
    size_t len = strlen(why);

    CHECK(len > 0 && len < WHY);
}

static void check_calibrated(const struct vs_calibration *c)
{
    static const int16_t ends[] = {INT16_MIN, -4096, -1, 0, 1, 1023, 4095, 4096, INT16_MAX};
    struct vs_base_reading reading;
    struct vs_base_command command;
    size_t i;
    int k;

    for (i = 0; i < sizeof ends / sizeof ends[0]; i++) {
        memset(&reading, 0, sizeof reading);
        memset(&command, 0, sizeof command);
        for (k = 0; k < 8; k++)
            reading.prox[k] = reading.light[k] = ends[i];
        for (k = 0; k < 3; k++)
            reading.ground[k] = ends[i];
        reading.steps[0] = 60000 * ends[i];
        reading.steps[1] = -60000 * ends[i];
        vs_calibration_sense(c, &reading, 0);
        vs_calibration_sense_ground(c, reading.ground);
        CHECK(c->text[VS_CAL_PROXIMITY] == NULL || (reading.prox[0] >= 0 && reading.prox[0] <= 4095));
        CHECK(c->text[VS_CAL_LIGHT] == NULL || (reading.light[7] >= 0 && reading.light[7] <= 4095));
        CHECK(c->text[VS_CAL_GROUND] == NULL || (reading.ground[2] >= 0 && reading.ground[2] <= 1023));
        command.left_steps_s = ends[i];
        command.right_steps_s = (int16_t)(ends[i] / 3);
        vs_calibration_drive(c, &command, 1000);
        CHECK(!c->has_wheels || (abs(command.left_steps_s) <= 1000 && abs(command.right_steps_s) <= 1000));
    }
}

static void check_base(const struct vs_base_config *base)
{
    if (base->ops == NULL)
        return;
    CHECK(base->device[0] != '\0' && strlen(base->device) <= VS_BASE_DEVICE_MAX);
    CHECK(base->rab_bytes == 2 || base->rab_bytes == 4);
    CHECK(base->rab_k_cm > 0.0f && base->rab_k_cm <= 10.0f);
    CHECK(strlen(base->reset) <= VS_BASE_DEVICE_MAX);
}

static void check_options(void)
{
    CHECK(strlen(options.name) <= VS_NAME_MAX);
    CHECK(options.battery_stop_mv <= 5000);
    CHECK(options.clock_drift_ppb >= -100000000 && options.clock_drift_ppb <= 100000000);
    check_base(&options.base);
    check_calibrated(&options.calibration);
}

static void try_arguments(struct input *in)
{
    static char program[] = "vsensed";
    char *argv[WORDS + 1];
    char why[WHY] = "";
    size_t len = take_text(in);
    size_t at = 0;
    int argc = 1;
    enum vs_options_result result;

    argv[0] = program;
    while (at <= len && argc < WORDS) {
        argv[argc++] = text + at;
        at += strlen(text + at) + 1;
    }
    argv[argc] = NULL;
    vs_options_init(&options);
    (void)vs_options_config(argc, argv);
    result = vs_options_read(&options, argc, argv, why, sizeof why);
    if (result == VS_OPTIONS_BAD)
        check_why(why);
    else if (result == VS_OPTIONS_RUN)
        CHECK(options.host != NULL && options.port != 0 && options.name[0] != '\0');
    if (result == VS_OPTIONS_RUN)
        check_options();
}

static void try_settings(struct input *in)
{
    char why[WHY] = "";

    settings.len = take_text(in);
    memcpy(settings.text, text, settings.len + 1);
    vs_options_init(&options);
    if (vs_options_read_settings(&options, "file", &settings, why, sizeof why) != 0)
        CHECK(strncmp(why, "file:", 5) == 0);
    else
        check_options();
}

static void try_base(struct input *in)
{
    char expected[WHY] = "";
    char expanded[4 * VS_BASE_DEVICE_MAX];
    struct vs_base_config base;
    const char *meant;

    (void)take_text(in);
    memset(&base, 0, sizeof base);
    meant = vs_preset_expand(text, expanded, sizeof expanded);
    CHECK(meant == text || (meant == expanded && strlen(expanded) < sizeof expanded));
    if (vs_base_configure(&base, meant, expected, sizeof expected) != 0)
        check_why(expected);
    else
        check_base(&base);
}

/* Of up to 15 digits and with a small exponent it is exactly strtod's. */
static void check_double(void)
{
    double value = 12345.0;
    size_t len = vs_number_read(text, &value);
    char copy[64];
    char *end;
    double expected;

    CHECK(len <= strlen(text));
    if (len == 0) {
        CHECK(value == 12345.0);
        return;
    }
    CHECK(isfinite(value));
    if (len >= sizeof copy)
        return;
    memcpy(copy, text, len);
    copy[len] = '\0';
    expected = strtod(copy, &end);
    CHECK(*end == '\0');
    CHECK(fabs(value - expected) <= 4.0 * 2.3e-16 * fabs(expected) + 2e-323);
}

static void try_numbers(struct input *in)
{
    int64_t whole = 0;
    uint8_t bytes[16];
    char said[64];
    char *end;

    (void)take_text(in);
    check_double();
    if (vs_number_whole(text, INT64_MIN, INT64_MAX, &whole) == 0) {
        CHECK(strtoll(text, &end, 10) == whole && *end == '\0');
        (void)vs_format(said, sizeof said, "%lld", (long long)whole);
        CHECK(strtoll(said, &end, 10) == whole && *end == '\0');
        CHECK(whole < 5 || vs_number_whole(text, 0, whole - 1, &whole) == -1);
    }
    if (vs_number_address(text, bytes) == 0) {
        (void)vs_format(said, sizeof said, "%u.%u.%u.%u", bytes[0], bytes[1], bytes[2], bytes[3]);
        CHECK(strcmp(said, text) == 0);
    }
    if (vs_number_hex(text, 1, bytes) == 0)
        CHECK(strlen(text) == 32 && vs_number_hex(text, 0, bytes) == 0);
    CHECK(vs_format(said, sizeof said, "%.*s|%-9s|", (int)(text[0] & 31), text, text) < sizeof said);
}

static void try_calibration(struct input *in)
{
    static struct vs_calibration calibration;
    uint32_t which = take_below(in, VS_CAL_SETTINGS);

    memset(&calibration, 0, sizeof calibration);
    (void)take_text(in);
    if (vs_calibration_take(&calibration, vs_calibration_name(which), text) == NULL)
        check_calibrated(&calibration);
    else
        CHECK(calibration.text[which] == NULL);
}

/* A key's file; where a line is refused, none of its words are said. */
static void try_key(struct input *in)
{
    static int file = -1;
    static char path[64];
    char why[WHY] = "";
    size_t len = take_text(in);
    int result;

    if (file < 0) {
        file = memfd_create("key", 0);
        CHECK(file >= 0 && fchmod(file, 0600) == 0);
        (void)vs_format(path, sizeof path, "/proc/self/fd/%d", file);
    }
    CHECK(ftruncate(file, 0) == 0 && pwrite(file, text, len, 0) == (ssize_t)len);
    vs_options_init(&options);
    options.key_file = path;
    result = vs_key_load(&options, why, sizeof why);
    CHECK((result == 0) == (options.keyed && options.has_uid));
    if (result != 0)
        CHECK(strncmp(why, path, strlen(path)) == 0 && why[strlen(path)] == ':');
    for (; result != 0 && len > 7; len--)
        CHECK(strlen(text + len - 8) < 8 || strpbrk(text + len - 8, " \n") != NULL ||
              strstr(why, text + len - 8) == NULL);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static void (*const tries[])(struct input *) = {try_arguments, try_settings,    try_base,
                                                    try_numbers,   try_calibration, try_key};
    struct input in = {data, size};

    tries[take_below(&in, 6)](&in);
    return 0;
}
