/* SPDX-License-Identifier: MIT */
#include "vs_format.h"

#include <stdint.h>

#define DIGITS_MAX 20 /* of a uint64_t */

struct text {
    char *buf;
    size_t size;
    size_t len;
};

/* One thing that begins with a percent sign. */
struct field {
    int left;
    int width;
    int precision; /* -1: none */
    int longs;
};

static void put(struct text *t, char c)
{
    if (t->len + 1 < t->size)
        t->buf[t->len++] = c;
}

static void put_blanks(struct text *t, int count)
{
    while (count-- > 0)
        put(t, ' ');
}

static void put_padded(struct text *t, const struct field *f, const char *what, int len)
{
    int i;

    if (!f->left)
        put_blanks(t, f->width - len);
    for (i = 0; i < len; i++)
        put(t, what[i]);
    if (f->left)
        put_blanks(t, f->width - len);
}

static void put_string(struct text *t, const struct field *f, const char *what)
{
    int len = 0;

    while (len != f->precision && what[len] != '\0')
        len++;
    put_padded(t, f, what, len);
}

static void put_number(struct text *t, const struct field *f, uint64_t value, int negative)
{
    char digits[DIGITS_MAX + 1];
    int at = DIGITS_MAX + 1;

    do {
        digits[--at] = (char)('0' + value % 10);
        value /= 10;
    } while (value != 0);
    if (negative)
        digits[--at] = '-';
    put_padded(t, f, digits + at, DIGITS_MAX + 1 - at);
}

static uint64_t take_unsigned(const struct field *f, va_list *values)
{
    if (f->longs == 0)
        return va_arg(*values, unsigned int);
    return f->longs == 1 ? va_arg(*values, unsigned long) : va_arg(*values, unsigned long long);
}

static int64_t take_signed(const struct field *f, va_list *values)
{
    if (f->longs == 0)
        return va_arg(*values, int);
    return f->longs == 1 ? va_arg(*values, long) : va_arg(*values, long long);
}

/* A number, or a star and the number among the values. */
static const char *read_count(const char *at, va_list *values, int *count)
{
    *count = 0;
    if (*at == '*') {
        *count = va_arg(*values, int);
        return at + 1;
    }
    for (; *at >= '0' && *at <= '9'; at++)
        *count = *count * 10 + (*at - '0');
    return at;
}

/* Reads what is between the percent sign and the letter. */
static const char *read_field(const char *at, va_list *values, struct field *f)
{
    f->left = *at == '-';
    f->precision = -1;
    at = read_count(at + f->left, values, &f->width);
    if (*at == '.')
        at = read_count(at + 1, values, &f->precision);
    for (f->longs = 0; *at == 'l'; at++)
        f->longs++;
    return at;
}

static void put_field(struct text *t, char letter, const struct field *f, va_list *values)
{
    int64_t value;

    switch (letter) {
    case 's':
        put_string(t, f, va_arg(*values, const char *));
        break;
    case 'd':
        value = take_signed(f, values);
        put_number(t, f, value < 0 ? 0 - (uint64_t)value : (uint64_t)value, value < 0);
        break;
    case 'u':
        put_number(t, f, take_unsigned(f, values), 0);
        break;
    default:
        put(t, letter);
        break;
    }
}

size_t vs_format_list(char *buf, size_t size, const char *format, va_list values)
{
    struct text text = {buf, size, 0};
    struct field field;
    va_list rest;

    va_copy(rest, values); /* a parameter of this type may be an array, which has no address */
    for (; *format != '\0'; format++) {
        if (*format != '%') {
            put(&text, *format);
            continue;
        }
        format = read_field(format + 1, &rest, &field);
        if (*format == '\0')
            break;
        put_field(&text, *format, &field, &rest);
    }
    va_end(rest);
    buf[text.len] = '\0';
    return text.len;
}

size_t vs_format(char *buf, size_t size, const char *format, ...)
{
    va_list values;
    size_t len;

    va_start(values, format);
    len = vs_format_list(buf, size, format, values);
    va_end(values);
    return len;
}
