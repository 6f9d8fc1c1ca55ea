/* SPDX-License-Identifier: MIT */
/* settings.h: every pair of a file comes out, with its line, whatever stands around it. */
#include "../../robot/settings.h"

#include <string.h>

#include "robot_check.h"

static struct vs_settings settings;

static void begin(const char *text, size_t len)
{
    memcpy(settings.text, text, len);
    settings.len = len;
    vs_settings_begin(&settings);
}

static void test_pairs_and_their_lines(void)
{
    const char *name;
    const char *value;
    const char *text = "# all of it\r\n\r\n  host\t= 10.0.0.1  \r\nname=a = b # c\nport = 4050";

    begin(text, strlen(text));
    CHECK(vs_settings_next(&settings, &name, &value) == VS_SETTINGS_PAIR);
    CHECK(strcmp(name, "host") == 0 && strcmp(value, "10.0.0.1") == 0 && settings.line == 3);
    CHECK(vs_settings_next(&settings, &name, &value) == VS_SETTINGS_PAIR);
    CHECK(strcmp(name, "name") == 0 && strcmp(value, "a = b # c") == 0 && settings.line == 4);
    CHECK(vs_settings_next(&settings, &name, &value) == VS_SETTINGS_PAIR);
    CHECK(strcmp(name, "port") == 0 && strcmp(value, "4050") == 0 && settings.line == 5);
    CHECK(vs_settings_next(&settings, &name, &value) == VS_SETTINGS_END);
    CHECK(vs_settings_next(&settings, &name, &value) == VS_SETTINGS_END);
}

static void test_lines_that_are_no_pairs(void)
{
    static const char *const lines[] = {"host", "= 1", "host =", "=", "  x  "};
    const char *name;
    const char *value;
    size_t i;

    for (i = 0; i < sizeof lines / sizeof lines[0]; i++) {
        begin(lines[i], strlen(lines[i]));
        CHECK(vs_settings_next(&settings, &name, &value) == VS_SETTINGS_BAD);
        CHECK(settings.line == 1);
    }
}

/* Any bytes: every result is one of the three, in at most as many calls as there are
 * lines, and what is pointed to lies in the text. */
static void test_any_text_ends(uint32_t seed)
{
    static const char alphabet[] = "ab= \t\r\n#\n=";
    size_t len;
    size_t lines = 1;
    size_t i;

    len = draw(&seed, seed % 7 == 0 ? VS_SETTINGS_MAX + 1 : 40);
    for (i = 0; i < len; i++) {
        settings.text[i] = alphabet[draw(&seed, sizeof alphabet - 1)];
        lines += settings.text[i] == '\n';
    }
    settings.len = len;
    vs_settings_begin(&settings);
    for (i = 0; i <= lines; i++) {
        const char *name = NULL;
        const char *value = NULL;
        enum vs_settings_result result = vs_settings_next(&settings, &name, &value);

        if (result == VS_SETTINGS_END)
            return;
        CHECK(settings.line <= lines);
        CHECK(name >= settings.text && name + strlen(name) <= settings.text + len);
        if (result == VS_SETTINGS_PAIR) {
            CHECK(*name != '\0' && *value != '\0');
            CHECK(value > name && value + strlen(value) <= settings.text + len);
        }
    }
    CHECK(0);
}

int main(void)
{
    uint32_t seed;

    test_pairs_and_their_lines();
    test_lines_that_are_no_pairs();
    for (seed = 1; seed <= 20000; seed++)
        test_any_text_ends(seed);
    return 0;
}
