/* SPDX-License-Identifier: MIT */
/*
 * vectors.hpp - ARGoS's vectors of two and three numbers.
 */
#ifndef VS_ARGOS_VECTORS_HPP
#define VS_ARGOS_VECTORS_HPP

#include <array>

#include "angles.hpp"

namespace argos {

class CQuaternion;

class CVector2
{
public:
    static const CVector2 X, Y, ZERO;

    constexpr CVector2() : m_x(0.0), m_y(0.0) {}
    constexpr CVector2(Real x, Real y) : m_x(x), m_y(y) {}
    CVector2(const std::array<Real, 2> &c) : m_x(c[0]), m_y(c[1]) {}
    CVector2(Real length, const CRadians &angle) { FromPolarCoordinates(length, angle); }

    Real GetX() const { return m_x; }
    Real GetY() const { return m_y; }
    void SetX(Real x) { m_x = x; }
    void SetY(Real y) { m_y = y; }
    void Set(const std::array<Real, 2> &c) { Set(c[0], c[1]); }
    void Set(Real x, Real y)
    {
        m_x = x;
        m_y = y;
    }

    void FromPolarCoordinates(Real length, const CRadians &angle)
    {
        Set(Cos(angle) * length, Sin(angle) * length);
    }

    Real SquareLength() const { return m_x * m_x + m_y * m_y; }
    Real Length() const { return Sqrt(SquareLength()); }
    CRadians Angle() const { return ATan2(m_y, m_x); }
    CVector2 &Normalize() { return *this /= Length(); }

    CVector2 &Rotate(const CRadians &angle)
    {
        const Real s = Sin(angle), c = Cos(angle);
        return *this = CVector2(m_x * c - m_y * s, m_x * s + m_y * c);
    }

    Real DotProduct(const CVector2 &v) const { return m_x * v.m_x + m_y * v.m_y; }
    Real CrossProduct(const CVector2 &v) const { return m_x * v.m_y - m_y * v.m_x; }
    CVector2 &Scale(Real x, Real y) { return *this = CVector2(m_x * x, m_y * y); }
    CVector2 &Perpendicularize() { return *this = CVector2(-m_y, m_x); }
    CVector2 &Absolute() { return *this = CVector2(Abs(m_x), Abs(m_y)); }

    bool operator==(const CVector2 &v) const { return m_x == v.m_x && m_y == v.m_y; }
    bool operator!=(const CVector2 &v) const { return !(*this == v); }
    CVector2 &operator+=(const CVector2 &v) { return *this = *this + v; }
    CVector2 &operator-=(const CVector2 &v) { return *this = *this - v; }
    CVector2 &operator*=(Real factor) { return *this = *this * factor; }
    CVector2 &operator/=(Real divisor) { return *this = *this / divisor; }
    CVector2 operator+(const CVector2 &v) const { return CVector2(m_x + v.m_x, m_y + v.m_y); }
    CVector2 operator-(const CVector2 &v) const { return CVector2(m_x - v.m_x, m_y - v.m_y); }
    CVector2 operator*(Real factor) const { return CVector2(m_x * factor, m_y * factor); }
    CVector2 operator/(Real divisor) const { return CVector2(m_x / divisor, m_y / divisor); }
    CVector2 operator-() const { return CVector2(-m_x, -m_y); }
    friend CVector2 operator*(Real factor, const CVector2 &v) { return v * factor; }

    friend std::ostream &operator<<(std::ostream &out, const CVector2 &v)
    {
        return out << v.m_x << "," << v.m_y;
    }

    friend std::istream &operator>>(std::istream &in, CVector2 &v)
    {
        Real parts[2];
        ParseValues<Real>(in, 2, parts, ',');
        v.Set(parts[0], parts[1]);
        return in;
    }

    friend bool VsScan(const std::string &text, CVector2 &v)
    {
        Real parts[2];
        ParseValues<Real>(text, 2, parts, ',');
        v.Set(parts[0], parts[1]);
        return true;
    }

private:
    Real m_x, m_y;
};

inline Real SquareDistance(const CVector2 &a, const CVector2 &b)
{
    return (a - b).SquareLength();
}

inline Real Distance(const CVector2 &a, const CVector2 &b)
{
    return (a - b).Length();
}

class CVector3
{
public:
    static const CVector3 X, Y, Z, ZERO;

    constexpr CVector3() : m_x(0.0), m_y(0.0), m_z(0.0) {}
    constexpr CVector3(Real x, Real y, Real z) : m_x(x), m_y(y), m_z(z) {}
    CVector3(const std::array<Real, 3> &c) : m_x(c[0]), m_y(c[1]), m_z(c[2]) {}
    CVector3(Real length, const CRadians &inclination, const CRadians &azimuth)
    {
        FromSphericalCoords(length, inclination, azimuth);
    }

    Real GetX() const { return m_x; }
    Real GetY() const { return m_y; }
    Real GetZ() const { return m_z; }
    void SetX(Real x) { m_x = x; }
    void SetY(Real y) { m_y = y; }
    void SetZ(Real z) { m_z = z; }
    void Set(const std::array<Real, 3> &c) { Set(c[0], c[1], c[2]); }
    void Set(Real x, Real y, Real z)
    {
        m_x = x;
        m_y = y;
        m_z = z;
    }

    /* The inclination is that from the z axis. */
    CVector3 &FromSphericalCoords(Real length, const CRadians &inclination, const CRadians &azimuth)
    {
        const Real flat = length * Sin(inclination);
        Set(flat * Cos(azimuth), flat * Sin(azimuth), length * Cos(inclination));
        return *this;
    }

    void ToSphericalCoords(Real &length, CRadians &inclination, CRadians &azimuth) const
    {
        length = Length();
        inclination = ACos(m_z / length);
        azimuth = ATan2(m_y, m_x);
    }

    Real SquareLength() const { return m_x * m_x + m_y * m_y + m_z * m_z; }
    Real Length() const { return Sqrt(SquareLength()); }
    CVector3 &Normalize() { return *this /= Length(); }

    CVector3 &RotateX(const CRadians &angle)
    {
        const Real s = Sin(angle), c = Cos(angle);
        return *this = CVector3(m_x, m_y * c - m_z * s, m_y * s + m_z * c);
    }

    CVector3 &RotateY(const CRadians &angle)
    {
        const Real s = Sin(angle), c = Cos(angle);
        return *this = CVector3(m_x * c + m_z * s, m_y, m_z * c - m_x * s);
    }

    CVector3 &RotateZ(const CRadians &angle)
    {
        return RotateZ(CVector2(Cos(angle), Sin(angle)));
    }

    /* By the angle of a vector of length 1. */
    CVector3 &RotateZ(const CVector2 &v)
    {
        const Real s = v.GetY(), c = v.GetX();
        return *this = CVector3(m_x * c - m_y * s, m_x * s + m_y * c, m_z);
    }

    CVector3 &Rotate(const CQuaternion &turn);

    CRadians GetAngleWith(const CVector3 &v) const
    {
        return ACos(DotProduct(v) / (Length() * v.Length()));
    }

    CRadians GetXAngle() const { return ATan2(m_z, m_y); }
    CRadians GetYAngle() const { return ATan2(m_x, m_z); }
    CRadians GetZAngle() const { return ATan2(m_y, m_x); }

    Real DotProduct(const CVector3 &v) const { return m_x * v.m_x + m_y * v.m_y + m_z * v.m_z; }
    CVector3 &CrossProduct(const CVector3 &v)
    {
        return *this = CVector3(m_y * v.m_z - m_z * v.m_y, m_z * v.m_x - m_x * v.m_z,
                                m_x * v.m_y - m_y * v.m_x);
    }

    CVector2 &ProjectOntoXY(CVector2 &onto) const { return onto = CVector2(m_x, m_y); }
    CVector2 &ProjectOntoYZ(CVector2 &onto) const { return onto = CVector2(m_y, m_z); }
    CVector2 &ProjectOntoXZ(CVector2 &onto) const { return onto = CVector2(m_x, m_z); }
    CVector3 &Negate() { return *this = -*this; }

    Real operator[](UInt32 index) const { return const_cast<CVector3 &>(*this)[index]; }
    Real &operator[](UInt32 index)
    {
        if (index > 2)
            THROW_ARGOSEXCEPTION("a vector of three numbers has none at index " << index);
        return index == 0 ? m_x : index == 1 ? m_y : m_z;
    }

    bool operator==(const CVector3 &v) const { return m_x == v.m_x && m_y == v.m_y && m_z == v.m_z; }
    bool operator!=(const CVector3 &v) const { return !(*this == v); }
    bool operator<(const CVector3 &v) const { return m_x < v.m_x && m_y < v.m_y && m_z < v.m_z; }
    bool operator<=(const CVector3 &v) const
    {
        return m_x <= v.m_x && m_y <= v.m_y && m_z <= v.m_z;
    }
    bool operator>(const CVector3 &v) const { return v < *this; }
    bool operator>=(const CVector3 &v) const { return v <= *this; }
    CVector3 &operator+=(const CVector3 &v) { return *this = *this + v; }
    CVector3 &operator-=(const CVector3 &v) { return *this = *this - v; }
    CVector3 &operator*=(Real factor) { return *this = *this * factor; }
    CVector3 &operator/=(Real divisor) { return *this = *this / divisor; }
    CVector3 operator+(const CVector3 &v) const
    {
        return CVector3(m_x + v.m_x, m_y + v.m_y, m_z + v.m_z);
    }
    CVector3 operator-(const CVector3 &v) const
    {
        return CVector3(m_x - v.m_x, m_y - v.m_y, m_z - v.m_z);
    }
    CVector3 operator*(Real factor) const
    {
        return CVector3(m_x * factor, m_y * factor, m_z * factor);
    }
    CVector3 operator/(Real divisor) const
    {
        return CVector3(m_x / divisor, m_y / divisor, m_z / divisor);
    }
    CVector3 operator-() const { return CVector3(-m_x, -m_y, -m_z); }
    friend CVector3 operator*(Real factor, const CVector3 &v) { return v * factor; }

    friend std::ostream &operator<<(std::ostream &out, const CVector3 &v)
    {
        return out << v.m_x << "," << v.m_y << "," << v.m_z;
    }

    friend std::istream &operator>>(std::istream &in, CVector3 &v)
    {
        Real parts[3];
        ParseValues<Real>(in, 3, parts, ',');
        v.Set(parts[0], parts[1], parts[2]);
        return in;
    }

    friend bool VsScan(const std::string &text, CVector3 &v)
    {
        Real parts[3];
        ParseValues<Real>(text, 3, parts, ',');
        v.Set(parts[0], parts[1], parts[2]);
        return true;
    }

private:
    Real m_x, m_y, m_z;
};

inline Real SquareDistance(const CVector3 &a, const CVector3 &b)
{
    return (a - b).SquareLength();
}

inline Real Distance(const CVector3 &a, const CVector3 &b)
{
    return (a - b).Length();
}

}  // namespace argos

#endif
