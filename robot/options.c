/* SPDX-License-Identifier: MIT */
#include "options.h"

#include <string.h>

#include "../c_src/vs_bytes.h"
#include "number.h"
#include "presets.h"
#include "../c_src/vs_format.h"

#define CLOCK_MAX_NS INT64_C(1000000000000000000)
#define DRIFT_MAX_PPM 100000.0
#define BATTERY_STOP_MAX_MV 5000

struct reading {
    const char *option;
    const char *value;
    char *why;
    size_t why_size;
};

static int refuse(const struct reading *r, const char *expected)
{
    vs_format(r->why, r->why_size, "%s: expected %s, got '%.100s'", r->option, expected, r->value);
    return -1;
}

static int read_number(const struct reading *r, uint16_t *number)
{
    int64_t value;

    if (vs_number_whole(r->value, 0, 65535, &value) != 0)
        return refuse(r, "a number from 0 to 65535");
    *number = (uint16_t)value;
    return 0;
}

int vs_options_make_uid(struct vs_options *options, const char *text)
{
    if (vs_number_hex(text, 0, options->uid) != 0)
        return -1;
    options->uid[0] ^= (uint8_t)(options->tag & 0xFF);
    options->uid[1] ^= (uint8_t)(options->tag >> 8);
    options->has_uid = 1;
    return 0;
}

static int take_uid(const struct reading *r, struct vs_options *o)
{
    o->has_uid = 1;
    if (vs_number_hex(r->value, 1, o->uid) == 0)
        return 0;
    return refuse(r, "32 hexadecimal digits");
}

static int take_name(const struct reading *r, struct vs_options *o)
{
    size_t len = strlen(r->value);

    if (len == 0 || len > VS_NAME_MAX || vs_text_check((const uint8_t *)r->value, len, 0) != VS_OK)
        return refuse(r, "1 to 31 bytes of plain UTF-8");
    memcpy(o->name, r->value, len + 1);
    return 0;
}

static int take_base(const struct reading *r, struct vs_options *o)
{
    char expanded[4 * VS_BASE_DEVICE_MAX];
    char expected[256];
    const char *text = vs_preset_expand(r->value, expanded, sizeof expanded);

    if (vs_base_configure(&o->base, text, expected, sizeof expected) == 0)
        return 0;
    return refuse(r, strchr(text, ':') != NULL ? expected : "KIND:DEVICE or a board's name");
}

static int take_calibration(const struct reading *r, struct vs_options *o)
{
    const char *name = r->option + strspn(r->option, "-");
    const char *expected = vs_calibration_take(&o->calibration, name, r->value);

    return expected == NULL ? 0 : refuse(r, expected);
}

static int take_offset(const struct reading *r, struct vs_options *o)
{
    if (vs_number_whole(r->value, -CLOCK_MAX_NS, CLOCK_MAX_NS, &o->clock_offset_ns) != 0)
        return refuse(r, "a whole number of nanoseconds");
    return 0;
}

static int take_drift(const struct reading *r, struct vs_options *o)
{
    double ppm = 0.0;
    size_t len = vs_number_read(r->value, &ppm);

    if (len == 0 || r->value[len] != '\0' || !(ppm >= -DRIFT_MAX_PPM && ppm <= DRIFT_MAX_PPM))
        return refuse(r, "parts per million, from -100000 to 100000");
    o->clock_drift_ppb = (int64_t)(ppm * 1000.0 + (ppm < 0 ? -0.5 : 0.5));
    return 0;
}

#ifdef VSENSED_SLOW_CLOCK
static int take_permille(const struct reading *r, struct vs_options *o)
{
    int64_t permille = 0;

    if (vs_number_whole(r->value, 1, 1000, &permille) != 0)
        return refuse(r, "1 to 1000");
    o->clock_permille = (uint32_t)permille;
    return 0;
}

static int take_radio(const struct reading *r, struct vs_options *o)
{
    o->radio = r->value;
    return 0;
}
#endif

static int take_host(const struct reading *r, struct vs_options *o)
{
    o->host = r->value;
    return 0;
}

static int take_trace(const struct reading *r, struct vs_options *o)
{
    o->trace = r->value;
    return 0;
}

static int take_key(const struct reading *r, struct vs_options *o)
{
    o->key_file = r->value;
    return 0;
}

static int take_insecure(const struct reading *r, struct vs_options *o)
{
    o->insecure = 1;
    return strcmp(r->value, "yes") == 0 ? 0 : refuse(r, "yes, or no such line");
}

static int take_watchdog(const struct reading *r, struct vs_options *o)
{
    o->watchdog = r->value;
    return 0;
}

static int take_battery_stop(const struct reading *r, struct vs_options *o)
{
    int64_t mv;

    if (vs_number_whole(r->value, 0, BATTERY_STOP_MAX_MV, &mv) != 0)
        return refuse(r, "millivolts, from 0 to 5000");
    o->battery_stop_mv = (uint16_t)mv;
    return 0;
}

static int take_port(const struct reading *r, struct vs_options *o)
{
    return read_number(r, &o->port);
}

static int take_tag(const struct reading *r, struct vs_options *o)
{
    o->has_tag = 1;
    return read_number(r, &o->tag);
}

static const struct {
    const char *name; /* in a settings file; on the command line with -- before it */
    int (*take)(const struct reading *r, struct vs_options *o); /* 0, or -1 and why */
} table[] = {
    {"host", take_host},
    {"port", take_port},
    {"tag", take_tag},
    {"base", take_base},
    {"uid", take_uid},
    {"key", take_key},
    {"insecure", take_insecure},
    {"name", take_name},
    {"watchdog", take_watchdog},
    {"battery-stop-mv", take_battery_stop},
    {"trace", take_trace},
    {"clock-offset-ns", take_offset},
    {"clock-drift-ppm", take_drift},
#ifdef VSENSED_SLOW_CLOCK
    {"clock-permille", take_permille},
    {"radio", take_radio},
#endif
    {"proximity-scale", take_calibration},
    {"light-scale", take_calibration},
    {"ground-scale", take_calibration},
    {"wheel-diameter", take_calibration},
    {"wheel-ratio", take_calibration},
    {"axle-length", take_calibration},
};

enum { OPTIONS = sizeof table / sizeof table[0] };

/* Its place in the table, OPTIONS if there is no such option. */
static size_t place(const char *name)
{
    size_t i = 0;

    while (i < OPTIONS && strcmp(name, table[i].name) != 0)
        i++;
    return i;
}

/* Takes one option and its value, NULL if there is none. 0, or -1 and why. */
static int take(struct vs_options *o, const char *name, const char *value,
                char *why, size_t why_size)
{
    struct reading r = {name, value, why, why_size};
    size_t i = strncmp(name, "--", 2) == 0 ? place(name + 2) : OPTIONS;

    if (i == OPTIONS && strcmp(name, "--config") != 0) {
        vs_format(why, why_size, "unknown option '%.100s'; see vsensed --help", name);
        return -1;
    }
    if (value == NULL) {
        vs_format(why, why_size, "%s: expected a value after it", name);
        return -1;
    }
    return i < OPTIONS ? table[i].take(&r, o) : 0; /* --config: was read before */
}

/* Takes one line of a settings file. 0, or -1 and why. */
static int take_line(struct vs_options *o, enum vs_settings_result kind, const char *name,
                     const char *value, unsigned int lines[OPTIONS], unsigned int line,
                     char *why, size_t why_size)
{
    struct reading r = {name, value, why, why_size};
    size_t i = place(name);

    if (kind == VS_SETTINGS_BAD) {
        vs_format(why, why_size, "expected a setting and its value, such as 'port = 4050', got "
                 "'%.100s'", name);
        return -1;
    }
    if (i == OPTIONS) {
        vs_format(why, why_size, "unknown setting '%.100s'; see vsensed --help", name);
        return -1;
    }
    if (lines[i] != 0) {
        vs_format(why, why_size, "%s: is set twice, before in line %u", name, lines[i]);
        return -1;
    }
    lines[i] = line;
    return table[i].take(&r, o);
}

/* What has no default was given: 0, or -1 and why. */
static int check(struct vs_options *o, char *why, size_t why_size)
{
    const char *missing = NULL;

    if (o->host == NULL)
        missing = "--host";
    else if (o->port == 0)
        missing = "--port";
    else if (!o->has_tag)
        missing = "--tag";
    else if (o->base.ops == NULL)
        missing = "--base";
    if (missing != NULL) {
        vs_format(why, why_size, "%s is missing; see vsensed --help", missing);
        return -1;
    }
    if ((o->key_file != NULL) == o->insecure) {
        vs_format(why, why_size, "%s: expected either --key FILE, which 'vsense robot deploy' "
                  "brings, or --insecure: obey anyone who sends commands",
                  o->insecure ? "--key and --insecure" : "--key is missing");
        return -1;
    }
    if (o->key_file != NULL && o->has_uid) {
        vs_format(why, why_size, "--uid: the file of --key says the robot's uid");
        return -1;
    }
#ifdef VSENSED_SLOW_CLOCK
    if (o->clock_permille != 1000 && strncmp(o->host, "127.", 4) != 0) {
        vs_format(why, why_size, "--clock-permille: such robots stop late: expected --host "
                  "127.0.0.1, got '%.100s'", o->host);
        return -1;
    }
#endif
    if (o->name[0] == '\0')
        vs_format(o->name, sizeof o->name, "robot_%u", (unsigned int)o->tag);
    return 0;
}

void vs_options_init(struct vs_options *options)
{
    memset(options, 0, sizeof *options);
#ifdef VSENSED_SLOW_CLOCK
    options->clock_permille = 1000;
#endif
}

/* 1 if no value comes after it. */
static int is_flag(const char *name)
{
    return strcmp(name, "--check") == 0 || strcmp(name, "--identify") == 0 ||
           strcmp(name, "--insecure") == 0
#ifdef VSENSED_DRIVERS
           || strcmp(name, "--wiggle") == 0
#endif
        ;
}

const char *vs_options_config(int argc, char *const argv[])
{
    const char *file = NULL;
    int i;

    for (i = 1; i < argc; i += is_flag(argv[i]) ? 1 : 2)
        if (strcmp(argv[i], "--config") == 0 && i + 1 < argc)
            file = argv[i + 1];
    return file;
}

int vs_options_read_settings(struct vs_options *options, const char *file,
                             struct vs_settings *settings, char *why, size_t why_size)
{
    unsigned int lines[OPTIONS] = {0};
    enum vs_settings_result kind;
    const char *name = "";
    const char *value = "";
    char what[200];

    vs_settings_begin(settings);
    while ((kind = vs_settings_next(settings, &name, &value)) != VS_SETTINGS_END)
        if (take_line(options, kind, name, value, lines, settings->line, what, sizeof what) != 0) {
            vs_format(why, why_size, "%s:%u: %s", file, settings->line, what);
            return -1;
        }
    return 0;
}

enum vs_options_result vs_options_read(struct vs_options *options, int argc, char *const argv[],
                                       char *why, size_t why_size)
{
    int i = 1;

    while (i < argc) {
        const char *value = i + 1 < argc ? argv[i + 1] : NULL;

        if (strcmp(argv[i], "--help") == 0)
            return VS_OPTIONS_HELP;
        if (strcmp(argv[i], "--version") == 0)
            return VS_OPTIONS_VERSION;
        if (is_flag(argv[i])) {
            options->check |= strcmp(argv[i], "--check") == 0;
#ifdef VSENSED_DRIVERS
            options->wiggle |= strcmp(argv[i], "--wiggle") == 0;
            options->check |= options->wiggle;
#endif
            options->insecure |= strcmp(argv[i], "--insecure") == 0;
            options->identify |= strcmp(argv[i], "--identify") == 0;
            i++;
            continue;
        }
        if (take(options, argv[i], value, why, why_size) != 0)
            return VS_OPTIONS_BAD;
        i += 2;
    }
    return check(options, why, why_size) == 0 ? VS_OPTIONS_RUN : VS_OPTIONS_BAD;
}
