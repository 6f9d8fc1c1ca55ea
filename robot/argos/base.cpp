/* SPDX-License-Identifier: MIT */
/*
 * base.cpp - constants, text, maths, bytes, exceptions and the log of ARGoS.
 */
#include "base.hpp"

#include <cctype>

#include <regex.h>

namespace argos {

const CRadians CRadians::PI(ARGOS_PI);
const CRadians CRadians::TWO_PI(2.0 * ARGOS_PI);
const CRadians CRadians::PI_OVER_TWO(ARGOS_PI / 2.0);
const CRadians CRadians::PI_OVER_THREE(ARGOS_PI / 3.0);
const CRadians CRadians::PI_OVER_FOUR(ARGOS_PI / 4.0);
const CRadians CRadians::PI_OVER_SIX(ARGOS_PI / 6.0);
const CRadians CRadians::ZERO;
const CRange<CRadians> CRadians::SIGNED_RANGE(CRadians(-ARGOS_PI), CRadians(ARGOS_PI));
const CRange<CRadians> CRadians::UNSIGNED_RANGE(CRadians(0.0), CRadians(2.0 * ARGOS_PI));
const Real CRadians::RADIANS_TO_DEGREES = 180.0 / ARGOS_PI;
const CRange<CDegrees> CDegrees::SIGNED_RANGE(CDegrees(-180.0), CDegrees(180.0));
const CRange<CDegrees> CDegrees::UNSIGNED_RANGE(CDegrees(0.0), CDegrees(360.0));
const Real CDegrees::DEGREES_TO_RADIANS = ARGOS_PI / 180.0;

const CVector2 CVector2::X(1.0, 0.0);
const CVector2 CVector2::Y(0.0, 1.0);
const CVector2 CVector2::ZERO;
const CVector3 CVector3::X(1.0, 0.0, 0.0);
const CVector3 CVector3::Y(0.0, 1.0, 0.0);
const CVector3 CVector3::Z(0.0, 0.0, 1.0);
const CVector3 CVector3::ZERO;

CColor CColor::BLACK(0, 0, 0), CColor::WHITE(255, 255, 255), CColor::RED(255, 0, 0);
CColor CColor::GREEN(0, 255, 0), CColor::BLUE(0, 0, 255), CColor::MAGENTA(255, 0, 255);
CColor CColor::CYAN(0, 255, 255), CColor::YELLOW(255, 255, 0), CColor::ORANGE(255, 140, 0);
CColor CColor::BROWN(165, 42, 42), CColor::PURPLE(160, 32, 240), CColor::GRAY10(26, 26, 26);
CColor CColor::GRAY20(51, 51, 51), CColor::GRAY30(77, 77, 77), CColor::GRAY40(102, 102, 102);
CColor CColor::GRAY50(127, 127, 127), CColor::GRAY60(153, 153, 153), CColor::GRAY70(179, 179, 179);
CColor CColor::GRAY80(204, 204, 204), CColor::GRAY90(229, 229, 229);

namespace {

const struct
{
    const char *name;
    const CColor *color;
} COLORS[] = {
    {"black", &CColor::BLACK},   {"white", &CColor::WHITE},   {"red", &CColor::RED},
    {"green", &CColor::GREEN},   {"blue", &CColor::BLUE},     {"magenta", &CColor::MAGENTA},
    {"cyan", &CColor::CYAN},     {"yellow", &CColor::YELLOW}, {"orange", &CColor::ORANGE},
    {"brown", &CColor::BROWN},   {"purple", &CColor::PURPLE}, {"gray10", &CColor::GRAY10},
    {"gray20", &CColor::GRAY20}, {"gray30", &CColor::GRAY30}, {"gray40", &CColor::GRAY40},
    {"gray50", &CColor::GRAY50}, {"gray60", &CColor::GRAY60}, {"gray70", &CColor::GRAY70},
    {"gray80", &CColor::GRAY80}, {"gray90", &CColor::GRAY90},
};

}  // namespace

void CColor::Set(const std::string &text)
{
    for (const auto &known : COLORS)
        if (text == known.name) {
            *this = *known.color;
            return;
        }
    UInt16 parts[4] = {0, 0, 0, 0};
    ParseValues<UInt16>(text, 4, parts, ',');
    for (const UInt16 part : parts)
        if (part > 255)
            THROW_ARGOSEXCEPTION("color \"" << text << "\": " << part << " is larger than 255");
    Set(static_cast<UInt8>(parts[0]), static_cast<UInt8>(parts[1]), static_cast<UInt8>(parts[2]),
        static_cast<UInt8>(parts[3]));
}

std::string CColor::VsName() const
{
    for (const auto &known : COLORS)
        if (*this == *known.color)
            return known.name;
    VsWords words;
    words << m_red << "," << m_green << "," << m_blue << "," << m_alpha;
    return words.str();
}

/* ------------------------------------------------------------------ words and exceptions */

VsWords &VsWords::operator<<(const char *text)
{
    return *this << std::string(text == nullptr ? "" : text);
}

VsWords &VsWords::operator<<(const std::string &text)
{
    if (m_other != nullptr)
        m_other->Write(*this, text);
    else
        m_text += text;
    return *this;
}

VsWords &VsWords::operator<<(char value)
{
    return *this << std::string(1, value);
}

VsWords &VsWords::Whole(SInt64 value)
{
    char text[24];
    if (m_other != nullptr)
        m_other->Write(*this, value);
    else
        m_text.append(text, static_cast<size_t>(std::snprintf(text, sizeof text, "%lld", value)));
    return *this;
}

VsWords &VsWords::Natural(UInt64 value)
{
    char text[24];
    if (m_other != nullptr)
        m_other->Write(*this, value);
    else
        m_text.append(text, static_cast<size_t>(std::snprintf(text, sizeof text, "%llu", value)));
    return *this;
}

VsWords &VsWords::Number(double value)
{
    char text[32];
    if (m_other != nullptr)
        m_other->Write(*this, value);
    else
        m_text.append(text, static_cast<size_t>(std::snprintf(text, sizeof text, "%g", value)));
    return *this;
}

namespace {

std::string Told(const std::string &what, std::exception *nested)
{
    const std::string told = "[FATAL] " + what;
    return nested == nullptr ? told : told + "\n" + nested->what();
}

}  // namespace

CARGoSException::CARGoSException(const std::string &what, std::exception *nested) noexcept
    : m_what(Told(what, nested))
{
}

CARGoSException::~CARGoSException() noexcept {}

const char *CARGoSException::what() const noexcept
{
    return m_what.c_str();
}

void VsThrow(const std::string &what, std::exception *nested)
{
#if VS_ARGOS_EXCEPTIONS
    throw CARGoSException(what, nested);
#else
    /* No object of that class: it would bring along 14 kB of the library's types. */
    vs_argos_fail(Told(what, nested).c_str());
#endif
}

/* ------------------------------------------------------------------ text */

namespace {

/* Where a number begins that a stream would read; nullptr: nowhere. Streams know no hexadecimal
 * digits, infinities and words here, strtod does. */
const char *NumberIn(const std::string &text)
{
    const char *at = text.c_str() + std::min(text.find_first_not_of(" \t\n\r\v\f"), text.size());
    const char *digit = at + (*at == '+' || *at == '-');
    digit += *digit == '.';
    return std::isdigit(static_cast<unsigned char>(*digit)) ? at : nullptr;
}

}  // namespace

bool VsScan(const std::string &text, double &value)
{
    const char *at = NumberIn(text);
    if (at == nullptr)
        return false;
    /* Of "0x1p3" a stream reads the 0 alone. */
    value = std::strtod(std::string(at, std::strspn(at, "+-.0123456789eE")).c_str(), nullptr);
    return value >= -HUGE_VAL && value <= HUGE_VAL && std::fabs(value) != HUGE_VAL;
}

bool VsScan(const std::string &text, SInt64 &value)
{
    char *end = nullptr;
    const char *at = NumberIn(text);
    const SInt64 read = at == nullptr ? 0 : std::strtoll(at, &end, 10);
    if (end == at || at == nullptr)
        return false;
    value = read;
    return true;
}

bool VsScan(const std::string &text, UInt64 &value)
{
    char *end = nullptr;
    const char *at = NumberIn(text);
    const UInt64 read = at == nullptr ? 0 : std::strtoull(at, &end, 10);
    if (end == at || at == nullptr)
        return false;
    value = read;
    return true;
}

bool VsScan(const std::string &text, bool &value)
{
    value = text == "true" || text == "1";
    return value || text == "false" || text == "0";
}

std::vector<std::string> VsParts(const std::string &text, char delimiter)
{
    std::vector<std::string> parts;
    for (size_t from = 0; from < text.size();) {
        const size_t to = std::min(text.find(delimiter, from), text.size());
        parts.push_back(text.substr(from, to - from));
        from = to + 1;
    }
    return parts;
}

void Tokenize(const std::string &text, std::vector<std::string> &tokens,
              const std::string &delimiters)
{
    size_t to = 0;
    for (;;) {
        const size_t from = text.find_first_not_of(delimiters, to);
        if (from == std::string::npos)
            return;
        to = std::min(text.find_first_of(delimiters, from), text.size());
        tokens.push_back(text.substr(from, to - from));
    }
}

std::string StringToUpperCase(const std::string &text)
{
    std::string changed(text);
    for (char &letter : changed)
        letter = static_cast<char>(std::toupper(static_cast<unsigned char>(letter)));
    return changed;
}

std::string StringToLowerCase(const std::string &text)
{
    std::string changed(text);
    for (char &letter : changed)
        letter = static_cast<char>(std::tolower(static_cast<unsigned char>(letter)));
    return changed;
}

void Replace(std::string &text, const std::string &original, const std::string &replacement)
{
    size_t at = original.empty() ? std::string::npos : text.find(original);
    while (at != std::string::npos) {
        text.replace(at, original.size(), replacement);
        at = text.find(original, at + replacement.size());
    }
}

bool MatchPattern(const std::string &text, const std::string &pattern)
{
    regex_t expression;
    if (regcomp(&expression, pattern.c_str(), REG_EXTENDED | REG_NOSUB) != 0)
        return false;
    const bool found = regexec(&expression, text.c_str(), 0, nullptr, 0) == 0;
    regfree(&expression);
    return found;
}

std::string &ExpandEnvVariables(std::string &text)
{
    size_t at = text.find('$');
    while (at != std::string::npos && at + 1 < text.size()) {
        size_t end = at + 1;
        while (end < text.size() &&
               (std::isalnum(static_cast<unsigned char>(text[end])) || text[end] == '_'))
            ++end;
        const char *value = std::getenv(text.substr(at + 1, end - at - 1).c_str());
        text.replace(at, end - at, value == nullptr ? "" : value);
        at = text.find('$');
    }
    return text;
}

/* ------------------------------------------------------------------ turns */

CVector3 &CVector3::Rotate(const CQuaternion &turn)
{
    const CQuaternion turned = turn * CQuaternion(0.0, m_x, m_y, m_z) * turn.Inverse();
    return *this = CVector3(turned.GetX(), turned.GetY(), turned.GetZ());
}

CQuaternion &CQuaternion::FromAngleAxis(const CRadians &angle, const CVector3 &axis)
{
    const CRadians half = angle * 0.5;
    const Real s = Sin(half);
    return *this = CQuaternion(Cos(half), axis.GetX() * s, axis.GetY() * s, axis.GetZ() * s);
}

void CQuaternion::ToAngleAxis(CRadians &angle, CVector3 &axis) const
{
    const CVector3 imaginary(m_x, m_y, m_z);
    const bool is_turn = imaginary.SquareLength() > 0.0;
    angle = is_turn ? ACos(m_w) * 2.0 : CRadians::ZERO;
    axis = is_turn ? imaginary * (1.0 / imaginary.Length()) : CVector3::Z;
}

CQuaternion &CQuaternion::FromEulerAngles(const CRadians &z, const CRadians &y, const CRadians &x)
{
    return *this = CQuaternion(x, CVector3::X) * CQuaternion(y, CVector3::Y) *
                   CQuaternion(z, CVector3::Z);
}

void CQuaternion::ToEulerAngles(CRadians &z, CRadians &y, CRadians &x) const
{
    const Real pitch = m_x * m_z + m_w * m_y;

    /* Upright, the turns about x and z are one; ARGoS's limit, a float. */
    if (std::fabs(pitch) > 0.49999f) {
        x = CRadians::ZERO;
        y = pitch > 0.0 ? CRadians::PI_OVER_TWO : -CRadians::PI_OVER_TWO;
        z = ATan2(2.0 * (m_x * m_y + m_w * m_z), 1.0 - 2.0 * (m_x * m_x + m_z * m_z));
        return;
    }
    const Real ww = m_w * m_w, xx = m_x * m_x, yy = m_y * m_y, zz = m_z * m_z;
    x = ATan2(2.0 * (m_w * m_x - m_y * m_z), ww - xx - yy + zz);
    y = ASin(2.0 * pitch);
    z = ATan2(2.0 * (m_w * m_z - m_x * m_y), ww + xx - yy - zz);
}

CQuaternion &CQuaternion::BetweenTwoVectors(const CVector3 &from, const CVector3 &to)
{
    const Real lengths = Sqrt(from.SquareLength() * to.SquareLength());
    const Real cosine = from.DotProduct(to) / lengths;
    CVector3 axis(from);

    if (cosine > 0.999999f)
        return *this = CQuaternion();
    if (cosine < -0.999999f) {
        axis.CrossProduct(Abs(from.DotProduct(CVector3::X)) < 0.999999 ? CVector3::X : CVector3::Y);
        return FromAngleAxis(CRadians::PI, axis);
    }
    axis.CrossProduct(to);
    Set(lengths + cosine, axis.GetX(), axis.GetY(), axis.GetZ());
    return Normalize();
}

CQuaternion CQuaternion::operator*(const CQuaternion &q) const
{
    return CQuaternion(m_w * q.m_w - m_x * q.m_x - m_y * q.m_y - m_z * q.m_z,
                       m_w * q.m_x + m_x * q.m_w + m_y * q.m_z - m_z * q.m_y,
                       m_w * q.m_y - m_x * q.m_z + m_y * q.m_w + m_z * q.m_x,
                       m_w * q.m_z + m_x * q.m_y - m_y * q.m_x + m_z * q.m_w);
}

/* ------------------------------------------------------------------ bytes */

CByteArray &CByteArray::AddBuffer(const UInt8 *bytes, size_t size)
{
    m_bytes.insert(m_bytes.end(), bytes, bytes + size);
    return *this;
}

CByteArray &CByteArray::FetchBuffer(UInt8 *bytes, size_t size)
{
    if (Size() < size)
        THROW_ARGOSEXCEPTION("Attempting to extract too many bytes from byte array ("
                             << size << " requested, " << Size() << " available)");
    std::copy(m_bytes.begin(), m_bytes.begin() + static_cast<ssize_t>(size), bytes);
    m_bytes.erase(m_bytes.begin(), m_bytes.begin() + static_cast<ssize_t>(size));
    return *this;
}

CByteArray *CByteArray::operator()(size_t start, ssize_t end)
{
    if (start >= Size())
        THROW_ARGOSEXCEPTION("Attempting to extract from byte array beyond the limits ("
                             << start << " requested, " << Size() << " size)");
    const size_t stop = end < 0 ? Size() : std::min(static_cast<size_t>(end), Size());
    return new CByteArray(ToCArray() + start, stop - std::min(start, stop));
}

CByteArray &CByteArray::Put(UInt64 value, size_t size)
{
    for (size_t i = size; i > 0; --i)
        m_bytes.push_back(static_cast<UInt8>(value >> (8 * (i - 1))));
    return *this;
}

UInt64 CByteArray::Take(size_t size)
{
    UInt8 bytes[8];
    UInt64 value = 0;
    FetchBuffer(bytes, size);
    for (size_t i = 0; i < size; ++i)
        value = value << 8 | bytes[i];
    return value;
}

/* ARGoS's largest fraction, as a double: a fraction from 0.5 to 1 goes from 1 to this. */
static const double LARGEST_FRACTION = 9223372036854775806.0;

CByteArray &CByteArray::operator<<(double value)
{
    SInt32 exponent;
    const double beyond_half = std::fabs(std::frexp(value, &exponent)) - 0.5;
    SInt64 fraction = 0;

    if (beyond_half >= 0.0)
        fraction = static_cast<SInt64>(beyond_half * 2.0 * LARGEST_FRACTION) + 1;
    return *this << (value < 0.0 ? -fraction : fraction) << exponent;
}

CByteArray &CByteArray::operator>>(double &value)
{
    SInt64 fraction;
    SInt32 exponent;
    if (Size() < sizeof fraction + sizeof exponent)
        THROW_ARGOSEXCEPTION("Attempting to extract too many bytes from byte array (12 requested, "
                             << Size() << " available)");
    *this >> fraction >> exponent;
    const double part = static_cast<double>(Abs(fraction) - 1) / LARGEST_FRACTION;
    value = fraction == 0 ? 0.0 : std::ldexp(part / 2.0 + 0.5, exponent);
    if (fraction < 0)
        value = -value;
    return *this;
}

CByteArray &CByteArray::operator<<(const std::string &value)
{
    m_bytes.insert(m_bytes.end(), value.begin(), value.end());
    m_bytes.push_back(0);
    return *this;
}

CByteArray &CByteArray::operator>>(std::string &value)
{
    if (Empty())
        THROW_ARGOSEXCEPTION("Attempting to extract values from empty byte array");
    const std::vector<UInt8>::iterator end = std::find(m_bytes.begin(), m_bytes.end(), 0);
    value.assign(m_bytes.begin(), end);
    m_bytes.erase(m_bytes.begin(), end == m_bytes.end() ? end : end + 1);
    return *this;
}

/* ------------------------------------------------------------------ log */

/* Ready before any constructor of the user's own objects. */
CARGoSLog LOG __attribute__((init_priority(101)))(false);
CARGoSLog LOGERR __attribute__((init_priority(101)))(true);

CARGoSLog &CARGoSLog::Say()
{
    const std::string text = m_words.str();
    const size_t end = text.rfind('\n');
    if (end == std::string::npos)
        return *this;
    for (const std::string &line : VsParts(text.substr(0, end + 1), '\n'))
        vs_argos_log(m_is_error, line.c_str());
    m_words.clear();
    m_words.Add(text.data() + end + 1, text.size() - end - 1);
    return *this;
}

void CARGoSLog::VsWrite(const char *bytes, size_t count)
{
    m_words.Add(bytes, count);
    Say();
}

void CARGoSLog::Flush()
{
    if (!m_words.str().empty())
        VsWrite("\n", 1);
}

}  // namespace argos
