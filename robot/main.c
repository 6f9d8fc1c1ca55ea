/* SPDX-License-Identifier: MIT */
/*
 * vsensed - one robot's end of virtual sensing. The worker (this process,
 * worker.h) has network, clock and controller; the guard (guard.h) owns the base and
 * stops it whatever becomes of the worker; each board has a process that may hang.
 */
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "check.h"
#include "key.h"
#include "options.h"
#include "presets.h"
#include "radio.h"
#include "report.h"
#include "uid.h"
#include "worker.h"
#include "../c_src/vs_format.h"
#include "../c_src/vs_posix.h"

static void print_help(void)
{
    const struct vs_preset *preset;
    char line[200];
    size_t i;

    vs_print(vs_options_help);
    for (i = 0; vs_bases[i] != NULL; i++) {
        vs_print("  ");
        vs_print(vs_bases[i]->help);
        vs_print("\n");
    }
    vs_print("Boards:\n");
    for (preset = vs_presets; preset->name != NULL; preset++) {
        vs_format(line, sizeof line, "  %-12s  %s (%s)\n", preset->name, preset->base,
                  preset->about);
        vs_print(line);
    }
}

static int has_zero(const char *text, size_t len)
{
    while (len > 0)
        if (text[--len] == '\0')
            return 1;
    return 0;
}

/* Reads a settings file whole. 0, or -1 and why. */
static int load(const char *file, struct vs_settings *settings, char *why, size_t why_size)
{
    int fd = open(file, O_RDONLY | O_NONBLOCK);
    ssize_t len = 0;

    settings->len = 0;
    while (fd >= 0 && settings->len <= VS_SETTINGS_MAX &&
           (len = read(fd, settings->text + settings->len, sizeof settings->text -
                       settings->len)) > 0)
        settings->len += (size_t)len;
    if (fd < 0 || len < 0)
        vs_format(why, why_size, "%s: cannot be read: %s", file, vs_trouble(errno));
    else if (settings->len > VS_SETTINGS_MAX || has_zero(settings->text, settings->len))
        vs_format(why, why_size, "%s: expected a text of at most %d bytes", file, VS_SETTINGS_MAX);
    else
        len = 1;
    if (fd >= 0)
        close(fd);
    return len == 1 ? 0 : -1;
}

/* Reads settings file and command line. */
static enum vs_options_result read_options(struct vs_options *options, int argc, char *argv[],
                                           char *why, size_t why_size)
{
    static struct vs_settings settings;
    const char *file = vs_options_config(argc, argv);
    enum vs_options_result result;

    vs_options_init(options);
    options->argv = argv;
    if (file != NULL && (load(file, &settings, why, why_size) != 0 ||
                         vs_options_read_settings(options, file, &settings, why, why_size) != 0))
        return VS_OPTIONS_BAD;
    result = vs_options_read(options, argc, argv, why, why_size);
#ifdef VSENSED_SLOW_CLOCK
    vs_posix_slow(options->clock_permille);
    if (options->radio != NULL)
        vs_radio_emulate(options->radio);
#endif
    return result;
}

static void print_version(void)
{
    char line[200];

    vs_format(line, sizeof line, "vsensed %s, controller %s%s%s\n", vsensed_version,
              vs_controller.name, vsensed_controller_hash[0] != '\0' ? " " : "",
              vsensed_controller_hash);
    vs_print(line);
}

static void print_uid(const struct vs_options *options, const char *source)
{
    char uid[2 * VS_UID_SIZE + 1];
    char line[200];

    vs_uid_text(options->uid, uid);
    vs_format(line, sizeof line, "%s from %s\n", uid, source);
    vs_print(line);
}

int main(int argc, char *argv[])
{
    static struct vs_worker worker;
    struct vs_options options;
    const char *source;
    char why[400];

    switch (read_options(&options, argc, argv, why, sizeof why)) {
    case VS_OPTIONS_HELP:
        print_help();
        return 0;
    case VS_OPTIONS_VERSION:
        print_version();
        return 0;
    case VS_OPTIONS_BAD:
        vs_report("%s", why);
        return 2;
    default:
        break;
    }
    if (options.check)
        return vs_check_run(&options);
    vs_report_as(options.tag);
    if (vs_key_load(&options, why, sizeof why) != 0) {
        vs_report("%s", why);
        return 2;
    }
    source = vs_uid_find(&options);
    if (source == NULL) {
        vs_report("%s", vs_uid_missing);
        return 2;
    }
    if (options.identify) {
        print_uid(&options, source);
        return 0;
    }
    return vs_worker_run(&worker, &options);
}
