/* SPDX-License-Identifier: MIT */
#include "base_reset.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/gpio.h>
#include <poll.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "../c_src/vs_err.h"
#include "../c_src/vs_format.h"
#include "../c_src/vs_posix.h"

#define SYSFS "/sys/class/gpio"
#define PATH_MAX_BYTES 160
#define WAIT_MS 20

enum { KIND_SYSFS = 1, KIND_LINE = 2 };

/* Writes a word to a file that is there. Returns 0, or -1 with errno. */
static int put(const char *path, const char *word)
{
    int fd = open(path, O_WRONLY);
    ssize_t done;
    int why;

    if (fd < 0)
        return -1;
    done = write(fd, word, strlen(word));
    why = errno;
    close(fd);
    errno = why;
    return done < 0 ? -1 : 0;
}

/* Opens a GPIO that is exported: an output, high from the beginning. */
static int open_folder(struct vs_reset *reset, const char *folder)
{
    char path[PATH_MAX_BYTES];

    vs_format(path, sizeof path, "%s/direction", folder);
    if (put(path, "high") != 0)
        return -1;
    vs_format(path, sizeof path, "%s/value", folder);
    reset->fd = open(path, O_WRONLY);
    reset->kind = KIND_SYSFS;
    return reset->fd < 0 ? -1 : 0;
}

/* Asks for a line of the first GPIO chip. Its second interface is as old as Linux 5.10; older
 * ones have sysfs. */
static int open_line(struct vs_reset *reset, const char *number)
{
    struct gpio_v2_line_request request;
    int chip = open("/dev/gpiochip0", O_RDWR);
    int err;
    int why;

    if (chip < 0)
        return -1;
    memset(&request, 0, sizeof request);
    for (; *number != '\0'; number++)
        request.offsets[0] = 10 * request.offsets[0] + (uint32_t)(*number - '0');
    request.num_lines = 1;
    memcpy(request.consumer, "vsensed", sizeof "vsensed");
    request.config.flags = GPIO_V2_LINE_FLAG_OUTPUT;
    request.config.num_attrs = 1;
    request.config.attrs[0].mask = 1;
    request.config.attrs[0].attr.id = GPIO_V2_LINE_ATTR_ID_OUTPUT_VALUES;
    request.config.attrs[0].attr.values = 1;
    err = ioctl(chip, GPIO_V2_GET_LINE_IOCTL, &request);
    why = errno;
    close(chip);
    errno = why;
    reset->fd = request.fd;
    reset->kind = KIND_LINE;
    return err < 0 ? -1 : 0;
}

static int open_number(struct vs_reset *reset, const char *number)
{
    char folder[PATH_MAX_BYTES];

    vs_format(folder, sizeof folder, SYSFS "/gpio%s", number);
    if (open_folder(reset, folder) == 0)
        return 0;
    if (put(SYSFS "/export", number) == 0)
        return open_folder(reset, folder);
    return open_line(reset, number);
}

int vs_reset_open(struct vs_reset *reset, const char *name)
{
    int err = *name == '/' ? open_folder(reset, name) : open_number(reset, name);

    if (err != 0) {
        reset->kind = 0;
        return VS_ERR_IO;
    }
    vs_posix_keep_from_children(reset->fd);
    return VS_OK;
}

static void set(const struct vs_reset *reset, int level)
{
    struct gpio_v2_line_values values = {level ? 1u : 0u, 1u};
    ssize_t ignored;

    if (reset->kind == KIND_SYSFS)
        ignored = pwrite(reset->fd, level ? "1" : "0", 1, 0);
    else
        ignored = ioctl(reset->fd, GPIO_V2_LINE_SET_VALUES_IOCTL, &values);
    (void)ignored; /* nothing is left that could be tried */
}

int vs_reset_begin(struct vs_reset *reset, uint64_t now_ns)
{
    if (reset->kind == 0 ||
        (reset->begun_ns != 0 && now_ns - reset->begun_ns < VS_RESET_REST_NS))
        return 0;
    set(reset, 0);
    reset->held = 1;
    reset->begun_ns = now_ns;
    return 1;
}

int vs_reset_lasts(struct vs_reset *reset, uint64_t now_ns)
{
    if (!reset->held)
        return 0;
    if (now_ns - reset->begun_ns < VS_RESET_HOLD_NS) {
        poll(NULL, 0, WAIT_MS);
        (void)vs_posix_now_ns(); /* that took its time */
        return 1;
    }
    set(reset, 1);
    reset->held = 0;
    return 0;
}
