/* SPDX-License-Identifier: MIT */
/*
 * angles.hpp - ARGoS's ranges and angles. The constants are made by the compiler, so that they
 * have their values whichever file's own constants begin first.
 */
#ifndef VS_ARGOS_ANGLES_HPP
#define VS_ARGOS_ANGLES_HPP

#include "text.hpp"

namespace argos {

/* From a minimum to a maximum. Nobody checks their order: published files have it both ways. */
template <typename T> class CRange
{
public:
    constexpr CRange(const T &min = T(), const T &max = T())
        : m_min(min), m_max(max), m_span(max - min)
    {
    }

    constexpr T GetMin() const { return m_min; }
    constexpr T GetMax() const { return m_max; }
    constexpr T GetSpan() const { return m_span; }
    void SetMin(const T &min) { Set(min, m_max); }
    void SetMax(const T &max) { Set(m_min, max); }

    void Set(const T &min, const T &max)
    {
        m_min = min;
        m_max = max;
        m_span = max - min;
    }

    bool WithinMinBoundIncludedMaxBoundIncluded(const T &value) const
    {
        return value >= m_min && value <= m_max;
    }

    bool WithinMinBoundIncludedMaxBoundExcluded(const T &value) const
    {
        return value >= m_min && value < m_max;
    }

    bool WithinMinBoundExcludedMaxBoundIncluded(const T &value) const
    {
        return value > m_min && value <= m_max;
    }

    bool WithinMinBoundExcludedMaxBoundExcluded(const T &value) const
    {
        return value > m_min && value < m_max;
    }

    void TruncValue(T &value) const
    {
        if (value > m_max)
            value = m_max;
        if (value < m_min)
            value = m_min;
    }

    Real NormalizeValue(const T &value) const
    {
        T within(value);
        TruncValue(within);
        return static_cast<Real>(within - m_min) / static_cast<Real>(m_span);
    }

    template <typename U>
    void MapValueIntoRange(U &output, const T &input, const CRange<U> &range) const
    {
        output = static_cast<U>((NormalizeValue(input) * range.GetSpan()) + range.GetMin());
    }

    void WrapValue(T &value) const
    {
        while (value > m_max)
            value -= m_span;
        while (value < m_min)
            value += m_span;
    }

    friend std::ostream &operator<<(std::ostream &out, const CRange &range)
    {
        return out << range.m_min << ":" << range.m_max;
    }

    friend std::istream &operator>>(std::istream &in, CRange &range)
    {
        T ends[2];
        ParseValues<T>(in, 2, ends, ':');
        range.Set(ends[0], ends[1]);
        return in;
    }

private:
    T m_min, m_max, m_span;
};

template <typename T> bool VsScan(const std::string &text, CRange<T> &range)
{
    T ends[2];
    ParseValues<T>(text, 2, ends, ':');
    range.Set(ends[0], ends[1]);
    return true;
}

/* What radians and degrees have in common: a number that mixes with its own kind only. */
template <typename Angle> class VsAngle
{
public:
    constexpr Real GetValue() const { return m_value; }
    Real GetAbsoluteValue() const { return Abs(m_value); }
    void SetValue(Real value) { m_value = value; }

    Angle &SignedNormalize()
    {
        Angle::SIGNED_RANGE.WrapValue(Self());
        return Self();
    }

    Angle &UnsignedNormalize()
    {
        Angle::UNSIGNED_RANGE.WrapValue(Self());
        return Self();
    }

    Angle &Negate() { return Put(-m_value); }
    Angle &operator+() { return Self(); }
    constexpr Angle operator-() const { return Angle(-m_value); }
    Angle &operator+=(const Angle &other) { return Put(m_value + other.m_value); }
    Angle &operator-=(const Angle &other) { return Put(m_value - other.m_value); }
    Angle &operator*=(Real factor) { return Put(m_value * factor); }
    Angle &operator/=(Real divisor) { return Put(m_value / divisor); }
    constexpr Angle operator+(const Angle &other) const { return Angle(m_value + other.m_value); }
    constexpr Angle operator-(const Angle &other) const { return Angle(m_value - other.m_value); }
    constexpr Angle operator*(Real factor) const { return Angle(m_value * factor); }
    constexpr Angle operator/(Real divisor) const { return Angle(m_value / divisor); }
    constexpr Real operator/(const Angle &other) const { return m_value / other.m_value; }
    friend constexpr Angle operator*(Real factor, const Angle &angle) { return angle * factor; }
    constexpr bool operator<(const Angle &other) const { return m_value < other.m_value; }
    constexpr bool operator<=(const Angle &other) const { return m_value <= other.m_value; }
    constexpr bool operator>(const Angle &other) const { return m_value > other.m_value; }
    constexpr bool operator>=(const Angle &other) const { return m_value >= other.m_value; }
    constexpr bool operator==(const Angle &other) const { return m_value == other.m_value; }
    constexpr bool operator!=(const Angle &other) const { return m_value != other.m_value; }

    friend std::istream &operator>>(std::istream &in, Angle &angle)
    {
        Real value = angle.GetValue();
        in >> value;
        angle.SetValue(value);
        return in;
    }

    friend bool VsScan(const std::string &text, Angle &angle)
    {
        Real value = angle.GetValue();
        const bool good = VsScan(text, value);
        angle.SetValue(value);
        return good;
    }

protected:
    constexpr explicit VsAngle(Real value) : m_value(value) {}

private:
    Angle &Self() { return static_cast<Angle &>(*this); }

    Angle &Put(Real value)
    {
        m_value = value;
        return Self();
    }

    Real m_value;
};

class CRadians : public VsAngle<CRadians>
{
public:
    static const CRadians PI, TWO_PI, PI_OVER_TWO, PI_OVER_THREE, PI_OVER_FOUR, PI_OVER_SIX, ZERO;
    static const CRange<CRadians> SIGNED_RANGE, UNSIGNED_RANGE;
    static const Real RADIANS_TO_DEGREES;

    constexpr CRadians() : VsAngle<CRadians>(0.0) {}
    constexpr explicit CRadians(Real value) : VsAngle<CRadians>(value) {}
    void FromValueInDegrees(Real value) { SetValue(value / RADIANS_TO_DEGREES); }

    friend std::ostream &operator<<(std::ostream &out, const CRadians &angle)
    {
        const Real degrees = angle.GetValue() * RADIANS_TO_DEGREES;
        return out << "CRadians(" << angle.GetValue() << " -> " << degrees << " degrees)";
    }
};

class CDegrees : public VsAngle<CDegrees>
{
public:
    static const CRange<CDegrees> SIGNED_RANGE, UNSIGNED_RANGE;
    static const Real DEGREES_TO_RADIANS;

    constexpr CDegrees() : VsAngle<CDegrees>(0.0) {}
    constexpr explicit CDegrees(Real value) : VsAngle<CDegrees>(value) {}
    void FromValueInRadians(Real value) { SetValue(value / DEGREES_TO_RADIANS); }

    friend std::ostream &operator<<(std::ostream &out, const CDegrees &angle)
    {
        return out << "CDegrees(" << angle.GetValue() << ")";
    }
};

inline CDegrees ToDegrees(const CRadians &angle)
{
    return CDegrees(angle.GetValue() * CRadians::RADIANS_TO_DEGREES);
}

inline CRadians ToRadians(const CDegrees &angle)
{
    return CRadians(angle.GetValue() * CDegrees::DEGREES_TO_RADIANS);
}

/* The turn from b to a, from -half to half a turn. */
inline Real VsDifference(Real a, Real b, Real half)
{
    const Real rest = Mod(a - b + half, 2.0 * half);
    return (rest < 0.0 ? rest + 2.0 * half : rest) - half;
}

inline CRadians NormalizedDifference(const CRadians &a, const CRadians &b)
{
    return CRadians(VsDifference(a.GetValue(), b.GetValue(), ARGOS_PI));
}

inline CDegrees NormalizedDifference(const CDegrees &a, const CDegrees &b)
{
    return CDegrees(VsDifference(a.GetValue(), b.GetValue(), 180.0));
}

#define ARGOS_SIN ::sin
#define ARGOS_ASIN ::asin
#define ARGOS_COS ::cos
#define ARGOS_ACOS ::acos
#define ARGOS_TAN ::tan
#define ARGOS_ATAN2 ::atan2

inline Real Sin(const CRadians &angle)
{
    return std::sin(angle.GetValue());
}

inline Real Cos(const CRadians &angle)
{
    return std::cos(angle.GetValue());
}

inline Real Tan(const CRadians &angle)
{
    return std::tan(angle.GetValue());
}

inline void SinCos(const CRadians &angle, Real &sine, Real &cosine)
{
    sine = Sin(angle);
    cosine = Cos(angle);
}

inline CRadians ASin(Real value)
{
    return CRadians(std::asin(value));
}

inline CRadians ACos(Real value)
{
    return CRadians(std::acos(value));
}

inline CRadians ATan2(const Real y, const Real x)
{
    return CRadians(std::atan2(y, x));
}

}  // namespace argos

#endif
