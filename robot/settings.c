/* SPDX-License-Identifier: MIT */
#include "settings.h"

#include <string.h>

static int is_blank(char c)
{
    return c == ' ' || c == '\t' || c == '\r';
}

/* Cuts blanks off both ends of the text from begin to end. */
static char *trim(char *begin, char *end)
{
    while (begin < end && is_blank(*begin))
        begin++;
    while (end > begin && is_blank(end[-1]))
        end--;
    *end = '\0';
    return begin;
}

void vs_settings_begin(struct vs_settings *settings)
{
    settings->text[settings->len] = '\0';
    settings->pos = 0;
    settings->line = 0;
}

/* The next line, trimmed; NULL after the last. *end is where it ends. */
static char *next_line(struct vs_settings *s, char **end)
{
    char *begin = s->text + s->pos;
    char *last = s->text + s->len;

    if (s->pos >= s->len)
        return NULL;
    for (*end = begin; *end < last && **end != '\n';)
        ++*end;
    s->pos = (size_t)(*end - s->text) + 1;
    s->line++;
    begin = trim(begin, *end);
    *end = begin + strlen(begin);
    return begin;
}

enum vs_settings_result vs_settings_next(struct vs_settings *settings, const char **name,
                                         const char **value)
{
    char *line;
    char *end;

    while ((line = next_line(settings, &end)) != NULL) {
        char *equals = strchr(line, '=');

        if (*line == '\0' || *line == '#')
            continue;
        *name = line;
        if (equals == NULL)
            return VS_SETTINGS_BAD;
        *value = trim(equals + 1, end);
        *name = trim(line, equals);
        return **name != '\0' && **value != '\0' ? VS_SETTINGS_PAIR : VS_SETTINGS_BAD;
    }
    return VS_SETTINGS_END;
}
