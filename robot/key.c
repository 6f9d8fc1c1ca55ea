/* SPDX-License-Identifier: MIT */
#include "key.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "number.h"
#include "report.h"
#include "settings.h"
#include "../c_src/vs_format.h"

enum { HAS_UID = 1, HAS_KEY = 2 };

/* What is wrong with an open file, NULL if nothing is. */
static const char *fault_of(int fd)
{
    struct stat status;

    if (fstat(fd, &status) != 0)
        return vs_trouble(errno);
    if (!S_ISREG(status.st_mode))
        return "expected a file";
    if ((status.st_mode & (S_IRWXG | S_IRWXO)) != 0)
        return "others may read or change it: chmod 600 it";
    return NULL;
}

/* Reads it whole. Returns what is wrong, NULL if nothing is. */
static const char *read_all(const char *file, struct vs_settings *settings)
{
    int fd = open(file, O_RDONLY | O_NONBLOCK);
    const char *fault = fd < 0 ? vs_trouble(errno) : fault_of(fd);
    ssize_t len = 0;

    settings->len = 0;
    if (fault == NULL && (len = read(fd, settings->text, VS_SETTINGS_MAX)) < 0)
        fault = vs_trouble(errno);
    if (fault == NULL)
        settings->len = (size_t)len;
    if (fd >= 0)
        close(fd);
    return fault;
}

/* Takes the file's lines. Returns which of the two it holds, -1 if a line is none of them. */
static int take_lines(struct vs_options *o, struct vs_settings *settings)
{
    enum vs_settings_result kind;
    const char *name = "";
    const char *value = "";
    int found = 0;

    vs_settings_begin(settings);
    while ((kind = vs_settings_next(settings, &name, &value)) != VS_SETTINGS_END) {
        int is_key = kind == VS_SETTINGS_PAIR && strcmp(name, "key") == 0;
        int which = is_key ? HAS_KEY : HAS_UID;

        if (kind != VS_SETTINGS_PAIR || (!is_key && strcmp(name, "uid") != 0) ||
            (found & which) != 0 || vs_number_hex(value, 1, is_key ? o->key : o->uid) != 0)
            return -1;
        found |= which;
    }
    return found;
}

int vs_key_load(struct vs_options *o, char *why, size_t why_size)
{
    struct vs_settings settings;
    const char *fault;
    int found;

    if (o->key_file == NULL)
        return 0;
    fault = read_all(o->key_file, &settings);
    if (fault != NULL) {
        vs_format(why, why_size, "%s: %s", o->key_file, fault);
        return -1;
    }
    found = take_lines(o, &settings);
    memset(settings.text, 0, sizeof settings.text); /* a key lies in one place only */
    if (found != (HAS_UID | HAS_KEY)) {
        if (found < 0) /* its words may be a key's: they are not repeated */
            vs_format(why, why_size, "%s:%u: expected uid = or key = and 32 hexadecimal digits, "
                      "each once", o->key_file, settings.line);
        else
            vs_format(why, why_size, "%s: expected two lines, uid = and key =; bring it again with "
                      "vsense robot deploy", o->key_file);
        return -1;
    }
    o->has_uid = 1;
    o->keyed = 1;
    return 0;
}
