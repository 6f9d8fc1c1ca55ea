/* SPDX-License-Identifier: MIT */
/*
 * log.hpp - LOG and LOGERR of ARGoS: what is written there goes, line by line and without
 * colours, to `vs_argos_log`.
 */
#ifndef VS_ARGOS_LOG_HPP
#define VS_ARGOS_LOG_HPP

#include <fstream>
#include <iomanip>
#include <sstream>

#include "exception.hpp"

/* Takes a line, without its end. Whoever links these files defines it. */
extern "C" void vs_argos_log(int is_error, const char *line);

namespace argos {

enum EARGoSLogAttributes {
    ARGOS_LOG_ATTRIBUTE_RESET = 0,
    ARGOS_LOG_ATTRIBUTE_BRIGHT = 1,
    ARGOS_LOG_ATTRIBUTE_DIM = 2,
    ARGOS_LOG_ATTRIBUTE_UNDERSCORE = 3,
    ARGOS_LOG_ATTRIBUTE_BLINK = 5,
    ARGOS_LOG_ATTRIBUTE_REVERSE = 7,
    ARGOS_LOG_ATTRIBUTE_HIDDEN = 8
};

enum EARGoSLogColors {
    ARGOS_LOG_COLOR_BLACK = 0,
    ARGOS_LOG_COLOR_RED = 1,
    ARGOS_LOG_COLOR_GREEN = 2,
    ARGOS_LOG_COLOR_YELLOW = 3,
    ARGOS_LOG_COLOR_BLUE = 4,
    ARGOS_LOG_COLOR_MAGENTA = 5,
    ARGOS_LOG_COLOR_CYAN = 6,
    ARGOS_LOG_COLOR_WHITE = 7
};

/* Colours change nothing here: lines go to files and pages as well as to terminals. */
#define VS_ARGOS_PLAIN(color)                               \
    inline std::ostream &color(std::ostream &out)           \
    {                                                       \
        return out;                                         \
    }
VS_ARGOS_PLAIN(red)
VS_ARGOS_PLAIN(green)
VS_ARGOS_PLAIN(yellow)
VS_ARGOS_PLAIN(blue)
VS_ARGOS_PLAIN(magenta)
VS_ARGOS_PLAIN(cyan)
VS_ARGOS_PLAIN(white)
VS_ARGOS_PLAIN(reset)
#undef VS_ARGOS_PLAIN

class CARGoSLog
{
public:
    explicit CARGoSLog(bool is_error) : m_is_error(is_error), m_stream(nullptr) {}

    void EnableColoredOutput() {}
    void DisableColoredOutput() {}
    bool IsColoredOutput() const { return false; }
    void AddThreadSafeBuffer() {}

    /* A line that has no end yet is said, too. */
    void Flush();

    std::ostream &GetStream()
    {
        if (m_stream == nullptr)
            m_stream = new Stream(*this);
        return m_stream->out;
    }

    /* In place for the same reason as that of VsWords. */
    __attribute__((always_inline)) CARGoSLog &operator<<(std::ostream &(*manipulator)(std::ostream &))
    {
        m_words << manipulator;
        return Say();
    }

    template <typename T> CARGoSLog &operator<<(const T &value)
    {
        m_words << value;
        return Say();
    }

    /* Takes bytes that a stream has written. */
    void VsWrite(const char *bytes, size_t count);

private:
    struct Buffer : std::streambuf
    {
        CARGoSLog &log;

        explicit Buffer(CARGoSLog &target) : log(target) {}
        int overflow(int byte) override
        {
            const char letter = static_cast<char>(byte);
            log.VsWrite(&letter, 1);
            return byte;
        }
        std::streamsize xsputn(const char *bytes, std::streamsize count) override
        {
            log.VsWrite(bytes, static_cast<size_t>(count));
            return count;
        }
    };

    struct Stream
    {
        Buffer buffer;
        std::ostream out;

        explicit Stream(CARGoSLog &log) : buffer(log), out(&buffer) {}
    };

    /* Says all lines that have an end. */
    CARGoSLog &Say();

    bool m_is_error;
    VsWords m_words;
    Stream *m_stream;
};

extern CARGoSLog LOG, LOGERR;

}  // namespace argos

#define RLOG LOG << "[" << GetId() << "] "
#define RLOGERR LOGERR << "[" << GetId() << "] "

#define DEBUG(...) std::fprintf(stderr, "[DEBUG] " __VA_ARGS__)
#define DEBUG_FUNCTION_ENTER DEBUG("%s - START\n", __PRETTY_FUNCTION__)
#define DEBUG_FUNCTION_EXIT DEBUG("%s - END\n", __PRETTY_FUNCTION__)
#define TRACE(line)      \
    line;                \
    DEBUG(#line "\n")

#endif
