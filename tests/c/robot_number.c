/* SPDX-License-Identifier: MIT */
/* number.h against strtod(): the same numbers from the same characters. */
#include "../../robot/number.h"

#include <arpa/inet.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "robot_check.h"

static double read(const char *text, size_t len)
{
    double value = 77.0;

    CHECK_FOR(text, vs_number_read(text, &value) == len);
    return value;
}

static void test_numbers_and_where_they_end(void)
{
    CHECK(read("1.5\n", 3) == 1.5);
    CHECK(read("-7", 2) == -7.0);
    CHECK(read("+.25x", 4) == 0.25);
    CHECK(read("3.", 2) == 3.0);
    CHECK(read("2e3", 3) == 2000.0);
    CHECK(read("2E-3,", 4) == 0.002);
    CHECK(read("2e", 1) == 2.0);
    CHECK(read("2e+", 1) == 2.0);
    CHECK(read("0e999999999999", 14) == 0.0);
    CHECK(read("1e-999999999999", 15) == 0.0);
    CHECK(read("0.000000000000000000000000001", 29) == 1e-27);
    CHECK(read("00000000000000000000000000012", 29) == 12.0);
    CHECK(signbit(read("-0", 2)));
}

static void test_what_is_no_number(void)
{
    static const char *const texts[] = {"",    "-",   ".",   "-.", "e5",  "x1",
                                        " 1",  "nan", "inf", "0x", "1e400", "--1"};
    size_t i;

    for (i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        size_t len = strcmp(texts[i], "0x") == 0 ? 1 : 0;
        double value = 77.0;

        CHECK_FOR(texts[i], vs_number_read(texts[i], &value) == len);
        CHECK(len != 0 || value == 77.0);
    }
}

static void test_whole_numbers(void)
{
    static const char *const texts[] = {"", "-", "+", "1.5", "1e3", "12x", " 1", "--1",
                                        "9223372036854775808", "-9223372036854775809"};
    int64_t value = 0;
    size_t i;

    CHECK(vs_number_whole("0", 0, 65535, &value) == 0 && value == 0);
    CHECK(vs_number_whole("+007", 0, 65535, &value) == 0 && value == 7);
    CHECK(vs_number_whole("65535", 0, 65535, &value) == 0 && value == 65535);
    CHECK(vs_number_whole("-12", -12, 5, &value) == 0 && value == -12);
    CHECK(vs_number_whole("9223372036854775807", INT64_MIN, INT64_MAX, &value) == 0 &&
          value == INT64_MAX);
    CHECK(vs_number_whole("-9223372036854775808", INT64_MIN, INT64_MAX, &value) == 0 &&
          value == INT64_MIN);
    value = 77;
    CHECK(vs_number_whole("65536", 0, 65535, &value) != 0 && value == 77);
    CHECK(vs_number_whole("-1", 0, 65535, &value) != 0);
    for (i = 0; i < sizeof texts / sizeof texts[0]; i++)
        CHECK_FOR(texts[i], vs_number_whole(texts[i], INT64_MIN, INT64_MAX, &value) != 0);
}

/* A number of so many digits with a point somewhere and an exponent. */
static void make(char *text, size_t size, uint32_t *random, uint32_t digits, int exponent)
{
    uint32_t point = draw(random, digits + 1);
    size_t len = 0;
    uint32_t i;

    if (draw(random, 2))
        text[len++] = '-';
    for (i = 0; i < digits; i++) {
        if (i == point)
            text[len++] = '.';
        text[len++] = (char)('0' + draw(random, 10));
    }
    snprintf(text + len, size - len, "e%d", exponent);
}

static void test_against_strtod(uint32_t random)
{
    char text[80];
    char *end;
    double ours;
    double theirs;

    make(text, sizeof text, &random, 1 + draw(&random, 15), (int)draw(&random, 15) - 7);
    CHECK_FOR(text, vs_number_read(text, &ours) == strlen(text));
    CHECK_FOR(text, ours == strtod(text, NULL));
    make(text, sizeof text, &random, 1 + draw(&random, 40), (int)draw(&random, 500) - 250);
    theirs = strtod(text, &end);
    CHECK_FOR(text, vs_number_read(text, &ours) == (size_t)(end - text));
    CHECK_FOR(text, fabs(ours - theirs) <= 1e-15 * fabs(theirs));
}

static void test_addresses(void)
{
    static const char *const wrong[] = {"",          "1.2.3",     "1.2.3.4.",  "1.2.3.4.5", " 1.2.3.4",
                                        "1.2.3.256", "1.2..3",    "1.2.3.04",  "1.2.3.4a",  "1.2.3.1000",
                                        "-1.2.3.4",  "localhost", "1.2.3.4 ",  ".1.2.3.4",  "::1"};
    uint8_t address[4];
    size_t i;

    CHECK(vs_number_address("192.168.1.30", address) == 0);
    CHECK(address[0] == 192 && address[1] == 168 && address[2] == 1 && address[3] == 30);
    CHECK(vs_number_address("0.0.0.0", address) == 0 && address[3] == 0);
    CHECK(vs_number_address("255.255.255.255", address) == 0 && address[0] == 255);
    for (i = 0; i < sizeof wrong / sizeof wrong[0]; i++)
        CHECK_FOR(wrong[i], vs_number_address(wrong[i], address) == -1);
}

static void test_hexadecimal(void)
{
    static const char *const wrong[] = {"", "00", "0123456789abcdef0123456789abcde",
                                        "0123456789abcdef0123456789abcdeg", " 123456789abcdef0123456789abcdef"};
    uint8_t bytes[16];
    size_t i;

    CHECK(vs_number_hex("0123456789abcdefABCDEF9876543210", 1, bytes) == 0);
    CHECK(bytes[0] == 0x01 && bytes[7] == 0xEF && bytes[8] == 0xAB && bytes[15] == 0x10);
    CHECK(vs_number_hex("0123456789abcdef0123456789abcdef0", 0, bytes) == 0);
    CHECK(vs_number_hex("0123456789abcdef0123456789abcdef0", 1, bytes) == -1);
    for (i = 0; i < sizeof wrong / sizeof wrong[0]; i++)
        CHECK_FOR(wrong[i], vs_number_hex(wrong[i], 0, bytes) == -1);
}

int main(void)
{
    uint32_t seed;

    test_numbers_and_where_they_end();
    test_what_is_no_number();
    test_whole_numbers();
    test_addresses();
    test_hexadecimal();
    for (seed = 1; seed <= 100000; seed++)
        test_against_strtod(seed * 2654435761u | 1u);
    return 0;
}
