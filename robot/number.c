/* SPDX-License-Identifier: MIT */
#include "number.h"

#include <stdint.h>

#define DIGITS_MAX 18      /* so many fit a uint64_t */
#define EXPONENT_MAX 99999 /* beyond it nothing changes any more */
#define EXACT 22           /* 10^22 is the largest power of ten that a double holds */

struct decimal {
    uint64_t digits;
    int count;    /* of digits, but for leading zeros */
    int exponent; /* of ten */
    int any;      /* a digit was there */
};

static int is_digit(char c)
{
    return c >= '0' && c <= '9';
}

static void take_digit(struct decimal *d, char c, int after_point)
{
    d->any = 1;
    if (d->count < DIGITS_MAX) {
        d->digits = d->digits * 10 + (uint64_t)(c - '0');
        d->count += d->digits != 0;
        d->exponent -= after_point;
    } else {
        d->exponent += !after_point;
    }
}

static const char *read_digits(const char *at, struct decimal *d)
{
    while (is_digit(*at))
        take_digit(d, *at++, 0);
    if (*at != '.')
        return at;
    at++;
    while (is_digit(*at))
        take_digit(d, *at++, 1);
    return at;
}

/* An e without digits behind it does not belong to the number. */
static const char *read_exponent(const char *at, struct decimal *d)
{
    const char *begin = at;
    int negative;
    int value = 0;

    if (*at != 'e' && *at != 'E')
        return begin;
    at++;
    negative = *at == '-';
    at += *at == '-' || *at == '+';
    if (!is_digit(*at))
        return begin;
    for (; is_digit(*at); at++)
        value = value < EXPONENT_MAX ? value * 10 + (*at - '0') : value;
    d->exponent += negative ? -value : value;
    return at;
}

static double scaled(double value, int exponent)
{
    static const double powers[EXACT + 1] = {
        1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
        1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
    };

    for (; exponent > EXACT && value - value == 0.0 && value != 0.0; exponent -= EXACT)
        value *= powers[EXACT];
    for (; exponent < -EXACT && value != 0.0; exponent += EXACT)
        value /= powers[EXACT];
    if (value == 0.0 || value - value != 0.0)
        return value;
    return exponent < 0 ? value / powers[-exponent] : value * powers[exponent];
}

size_t vs_number_read(const char *text, double *value)
{
    struct decimal d = {0, 0, 0, 0};
    const char *at = text + (*text == '-' || *text == '+');
    double size;

    at = read_digits(at, &d);
    if (!d.any)
        return 0;
    at = read_exponent(at, &d);
    size = scaled((double)d.digits, d.exponent);
    if (size - size != 0.0)
        return 0;
    *value = *text == '-' ? -size : size;
    return (size_t)(at - text);
}

int vs_number_whole(const char *text, int64_t least, int64_t most, int64_t *value)
{
    int negative = *text == '-';
    int64_t whole = 0;

    text += negative || *text == '+';
    if (*text == '\0')
        return -1;
    for (; is_digit(*text); text++) {
        int digit = *text - '0';

        if (whole < (INT64_MIN + digit) / 10)
            return -1;
        whole = whole * 10 - digit; /* below 0, where one number more fits */
    }
    if (*text != '\0' || (!negative && whole == INT64_MIN))
        return -1;
    whole = negative ? whole : -whole;
    if (whole < least || whole > most)
        return -1;
    *value = whole;
    return 0;
}

int vs_number_address(const char *text, uint8_t address[4])
{
    int part;

    for (part = 0; part < 4; part++) {
        const char *begin = text;
        unsigned int value = 0;

        while (*text >= '0' && *text <= '9' && text - begin < 3)
            value = 10 * value + (unsigned int)(*text++ - '0');
        if (text == begin || (*begin == '0' && text - begin > 1) || value > 255 ||
            *text++ != (part < 3 ? '.' : '\0'))
            return -1;
        address[part] = (uint8_t)value;
    }
    return 0;
}

static int hex_digit(char c)
{
    if (c >= '0' && c <= '9')
        return c - '0';
    if (c >= 'a' && c <= 'f')
        return c - 'a' + 10;
    return c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

int vs_number_hex(const char *text, int whole, uint8_t bytes[16])
{
    size_t i;

    for (i = 0; i < 16; i++) {
        int high = hex_digit(text[2 * i]);
        int low = high < 0 ? -1 : hex_digit(text[2 * i + 1]);

        if (low < 0)
            return -1;
        bytes[i] = (uint8_t)(high << 4 | low);
    }
    return whole && text[32] != '\0' ? -1 : 0;
}
