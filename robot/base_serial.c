/* SPDX-License-Identifier: MIT */
#include "base_serial.h"

enum { STATE_FITS = 1 / (sizeof(struct vs_serial) <= VS_BASE_STATE_MAX) };

uint64_t vs_serial_now(const struct vs_base *base)
{
    return base->io.now_ns(base->io.context);
}

int vs_serial_write(struct vs_base *base, const uint8_t *buf, size_t len, uint64_t deadline_ns)
{
    struct vs_serial *line = vs_serial_of(base);

    line->got = 0;
    line->written_ns = vs_serial_now(base);
    return base->io.write(base->io.context, buf, len, deadline_ns);
}

int vs_serial_collect(struct vs_base *base, uint64_t deadline_ns)
{
    struct vs_serial *line = vs_serial_of(base);

    while (line->got < line->wanted) {
        int len;

        if (base->io.expect != NULL)
            base->io.expect(base->io.context, line->wanted - line->got);
        len = base->io.read(base->io.context, line->answer + line->got, line->wanted - line->got,
                            deadline_ns);
        if (len < 0)
            return len;
        if (len == 0)
            return VS_ERR_BUSY;
        line->got += (size_t)len;
    }
    return VS_OK;
}

int vs_serial_await(struct vs_base *base, uint64_t deadline_ns)
{
    const struct vs_serial *line = vs_serial_of(base);
    int err = vs_serial_collect(base, deadline_ns);

    if (err == VS_ERR_BUSY && vs_serial_now(base) >= line->written_ns + line->owed_ns)
        return VS_ERR_SILENT;
    return err;
}

int vs_serial_is_clear(struct vs_base *base)
{
    uint8_t stray;
    int err;

    if (vs_serial_of(base)->phase != VS_SERIAL_READY)
        return VS_ERR_SILENT;
    err = base->io.read(base->io.context, &stray, 1, 0);
    return err > 0 ? VS_ERR_GARBLED : err;
}

int vs_serial_drain(struct vs_base *base, uint64_t quiet_ns, uint64_t longest_ns,
                    void (*see)(struct vs_base *base, const uint8_t *buf, size_t len))
{
    uint64_t until_ns = vs_serial_now(base) + longest_ns;

    while (vs_serial_now(base) < until_ns) {
        uint8_t scrap[VS_SERIAL_ANSWER_MAX];
        int len = base->io.read(base->io.context, scrap, sizeof scrap,
                                vs_serial_now(base) + quiet_ns);

        if (len <= 0)
            return len;
        vs_serial_of(base)->got += (size_t)len;
        if (see)
            see(base, scrap, (size_t)len);
    }
    return VS_ERR_BUSY;
}
