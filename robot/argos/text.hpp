/* SPDX-License-Identifier: MIT */
/*
 * text.hpp - ARGoS's functions on strings, and how values are read from text.
 */
#ifndef VS_ARGOS_TEXT_HPP
#define VS_ARGOS_TEXT_HPP

#include <algorithm>
#include <map>
#include <sstream>

#include "exception.hpp"

namespace argos {

/*
 * Reads a value as `std::istream >>` would: leading blanks are skipped, what follows the value does
 * not matter. False: the text holds no such value. Types with more in them have an overload beside
 * them; all others need an operator>>.
 */
bool VsScan(const std::string &text, double &value);
bool VsScan(const std::string &text, SInt64 &value);
bool VsScan(const std::string &text, UInt64 &value);
bool VsScan(const std::string &text, bool &value); /* true, false, 1, 0 */

template <typename To, typename From> bool VsScanAs(const std::string &text, To &value)
{
    From wide;
    if (!VsScan(text, wide) || static_cast<From>(static_cast<To>(wide)) != wide)
        return false;
    value = static_cast<To>(wide);
    return true;
}

inline bool VsScan(const std::string &text, float &value)
{
    double wide;
    const bool good = VsScan(text, wide);
    value = good ? static_cast<float>(wide) : value;
    return good;
}

/* A number that was written with a sign wraps, as in a stream. */
inline bool VsScan(const std::string &text, UInt32 &value)
{
    const bool minus = text.find('-') != std::string::npos;
    SInt32 wrapped = 0;
    if (!minus)
        return VsScanAs<UInt32, UInt64>(text, value);
    const bool good = VsScanAs<SInt32, SInt64>(text, wrapped);
    value = good ? static_cast<UInt32>(wrapped) : value;
    return good;
}

inline bool VsScan(const std::string &text, SInt8 &value)
{
    return VsScanAs<SInt8, SInt64>(text, value);
}

inline bool VsScan(const std::string &text, UInt8 &value)
{
    return VsScanAs<UInt8, SInt64>(text, value);
}

inline bool VsScan(const std::string &text, SInt16 &value)
{
    return VsScanAs<SInt16, SInt64>(text, value);
}

inline bool VsScan(const std::string &text, UInt16 &value)
{
    return VsScanAs<UInt16, SInt64>(text, value);
}

inline bool VsScan(const std::string &text, SInt32 &value)
{
    return VsScanAs<SInt32, SInt64>(text, value);
}

inline bool VsScan(const std::string &text, long &value)
{
    return VsScanAs<long, SInt64>(text, value);
}

inline bool VsScan(const std::string &text, unsigned long &value)
{
    return VsScanAs<unsigned long, UInt64>(text, value);
}

inline bool VsScan(const std::string &text, std::string &value)
{
    value = text;
    return true;
}

template <typename T> bool VsScan(const std::string &text, T &value)
{
    std::istringstream stream(text);
    stream >> value;
    return !stream.fail();
}

inline std::string ToString(bool value)
{
    return value ? "true" : "false";
}

template <typename T> std::string ToString(const T &value)
{
    VsWords words;
    words << value;
    return words.str();
}

template <typename T> T FromString(const std::string &text)
{
    T value = T();
    VsScan(text, value);
    return value;
}

/* The parts of a text between delimiters; as std::getline, a last empty one is none. */
std::vector<std::string> VsParts(const std::string &text, char delimiter);

/* Exactly so many values, else an exception; one that is no such value stays as it was. */
template <typename T>
void ParseValues(const std::string &text, const UInt32 count, T *values, const char delimiter = '\n')
{
    const std::vector<std::string> parts = VsParts(text, delimiter);
    if (parts.size() < count)
        THROW_ARGOSEXCEPTION("Parse error: expected " << count << " values, but "
                             << parts.size() << " have been found in \"" << text << "\"");
    for (UInt32 i = 0; i < count; ++i)
        VsScan(parts[i].substr(std::min(parts[i].find_first_not_of(" \t\n"), parts[i].size())),
               values[i]);
}

template <typename T>
void ParseValues(std::istream &input, UInt32 count, T *values, const char delimiter = '\n')
{
    std::string text, part;
    for (UInt32 i = 0; i < count && std::getline(input, part, delimiter); ++i)
        text += (i > 0 ? std::string(1, delimiter) : std::string()) + part;
    ParseValues(text, count, values, delimiter);
    input.clear();
}

void Tokenize(const std::string &text, std::vector<std::string> &tokens,
              const std::string &delimiters = " ");
std::string StringToUpperCase(const std::string &text);
std::string StringToLowerCase(const std::string &text);
void Replace(std::string &text, const std::string &original, const std::string &replacement);
/* A POSIX extended regular expression found anywhere in the text. */
bool MatchPattern(const std::string &text, const std::string &pattern);
std::string &ExpandEnvVariables(std::string &text);

}  // namespace argos

#endif
