/* SPDX-License-Identifier: MIT */
/*
 * exception.hpp - ARGoS's exception and the macros that throw it. Code that is compiled without
 * exceptions ends in `vs_argos_fail` instead, which says the words and never returns.
 */
#ifndef VS_ARGOS_EXCEPTION_HPP
#define VS_ARGOS_EXCEPTION_HPP

#include <exception>
#include <sstream>
#include <stdexcept>

#include "types.hpp"

#if defined(__cpp_exceptions) || defined(__EXCEPTIONS)
#define VS_ARGOS_EXCEPTIONS 1
#else
#define VS_ARGOS_EXCEPTIONS 0
#endif

/* Says why nothing can go on, and never returns. Whoever links these files defines it. */
extern "C" [[noreturn]] void vs_argos_fail(const char *words);

namespace argos {

/*
 * Collects words as a stream would write them, without the 100 kB of one: strings and numbers are
 * written here. The first value of another type, also a manipulator, brings a real stream, which
 * then writes everything after it, so that std::setprecision holds for later numbers.
 */
class VsWords
{
public:
    VsWords() : m_other(nullptr) {}
    ~VsWords() { delete m_other; }
    VsWords(const VsWords &) = delete;
    VsWords &operator=(const VsWords &) = delete;

    const std::string &str() const { return m_text; }
    void clear() { m_text.clear(); }
    void Add(const char *bytes, size_t count) { m_text.append(bytes, count); }

    VsWords &operator<<(const char *text);
    VsWords &operator<<(char *text) { return *this << const_cast<const char *>(text); }
    VsWords &operator<<(const std::string &text);
    VsWords &operator<<(char value);
    VsWords &operator<<(bool value) { return Whole(value); }
    VsWords &operator<<(SInt8 value) { return Whole(value); }
    VsWords &operator<<(UInt8 value) { return Whole(value); }
    VsWords &operator<<(SInt16 value) { return Whole(value); }
    VsWords &operator<<(UInt16 value) { return Whole(value); }
    VsWords &operator<<(SInt32 value) { return Whole(value); }
    VsWords &operator<<(UInt32 value) { return Natural(value); }
    VsWords &operator<<(long value) { return Whole(value); }
    VsWords &operator<<(unsigned long value) { return Natural(value); }
    VsWords &operator<<(SInt64 value) { return Whole(value); }
    VsWords &operator<<(UInt64 value) { return Natural(value); }
    VsWords &operator<<(float value) { return Number(value); }
    VsWords &operator<<(double value) { return Number(value); }

    /* std::endl and std::flush are known by their address, so that they need no stream: it is
     * compared where the words are written, where the compiler sees which one it is. */
    __attribute__((always_inline)) VsWords &operator<<(
        std::ostream &(*manipulator)(std::ostream &))
    {
        if (manipulator == static_cast<std::ostream &(*)(std::ostream &)>(std::endl))
            m_text += '\n';
        else if (manipulator != static_cast<std::ostream &(*)(std::ostream &)>(std::flush))
            Other(manipulator);
        return *this;
    }

    VsWords &operator<<(std::ios_base &(*manipulator)(std::ios_base &))
    {
        return Other(manipulator);
    }

    template <typename T> VsWords &operator<<(const T &value) { return Other(value); }

private:
    /* A real stream behind virtual functions: it is linked where `Other` is used only. */
    struct Stream
    {
        virtual ~Stream() {}
        virtual void Write(VsWords &into, const std::string &text) = 0;
        virtual void Write(VsWords &into, SInt64 value) = 0;
        virtual void Write(VsWords &into, UInt64 value) = 0;
        virtual void Write(VsWords &into, double value) = 0;
    };

    struct RealStream : Stream
    {
        std::ostringstream stream;

        template <typename T> void Any(VsWords &into, const T &value)
        {
            stream << value;
            into.m_text += stream.str();
            stream.str(std::string());
        }
        void Write(VsWords &into, const std::string &text) override { Any(into, text); }
        void Write(VsWords &into, SInt64 value) override { Any(into, value); }
        void Write(VsWords &into, UInt64 value) override { Any(into, value); }
        void Write(VsWords &into, double value) override { Any(into, value); }
    };

    template <typename T> VsWords &Other(const T &value)
    {
        if (m_other == nullptr)
            m_other = new RealStream;
        static_cast<RealStream *>(m_other)->Any(*this, value);
        return *this;
    }

    VsWords &Whole(SInt64 value);
    VsWords &Natural(UInt64 value);
    VsWords &Number(double value);

    std::string m_text;
    Stream *m_other;
};

class CARGoSException : public std::exception
{
public:
    CARGoSException(const std::string &what, std::exception *nested = nullptr) noexcept;
    ~CARGoSException() noexcept override;
    const char *what() const noexcept override;

private:
    std::string m_what;
};

/* Throws a CARGoSException, or fails where there are no exceptions. */
[[noreturn]] void VsThrow(const std::string &what, std::exception *nested = nullptr);

}  // namespace argos

#define THROW_ARGOSEXCEPTION(message)       \
    {                                       \
        ::argos::VsWords vs_what;           \
        vs_what << message;                 \
        ::argos::VsThrow(vs_what.str());    \
    }

#define THROW_ARGOSEXCEPTION_NESTED(message, nested)    \
    {                                                   \
        ::argos::VsWords vs_what;                       \
        vs_what << message;                             \
        ::argos::VsThrow(vs_what.str(), &nested);       \
    }

#ifndef NDEBUG
#define ARGOS_ASSERT(condition, message)       \
    {                                          \
        if (!(condition))                      \
            THROW_ARGOSEXCEPTION(message);     \
    }
#else
#define ARGOS_ASSERT(condition, message)
#endif

#endif
