/* SPDX-License-Identifier: MIT */
/*
 * quaternion.hpp - ARGoS's turns in space. Euler angles are in the order z, y, x: the turn about
 * z is made first, in the frame of the arena.
 */
#ifndef VS_ARGOS_QUATERNION_HPP
#define VS_ARGOS_QUATERNION_HPP

#include "vectors.hpp"

namespace argos {

class CQuaternion
{
public:
    CQuaternion() : m_w(1.0), m_x(0.0), m_y(0.0), m_z(0.0) {}
    CQuaternion(Real w, Real x, Real y, Real z) : m_w(w), m_x(x), m_y(y), m_z(z) {}
    CQuaternion(const CRadians &angle, const CVector3 &axis) { FromAngleAxis(angle, axis); }
    CQuaternion(const CVector3 &from, const CVector3 &to) { BetweenTwoVectors(from, to); }

    Real GetW() const { return m_w; }
    Real GetX() const { return m_x; }
    Real GetY() const { return m_y; }
    Real GetZ() const { return m_z; }
    void SetW(Real w) { m_w = w; }
    void SetX(Real x) { m_x = x; }
    void SetY(Real y) { m_y = y; }
    void SetZ(Real z) { m_z = z; }
    void Set(Real w, Real x, Real y, Real z) { *this = CQuaternion(w, x, y, z); }

    CQuaternion Conjugate() const { return CQuaternion(m_w, -m_x, -m_y, -m_z); }
    /* Of a quaternion of length 1, as all turns are. */
    CQuaternion Inverse() const { return Conjugate(); }
    Real SquareLength() const { return m_w * m_w + m_x * m_x + m_y * m_y + m_z * m_z; }
    Real Length() const { return Sqrt(SquareLength()); }

    CQuaternion &Normalize()
    {
        const Real scale = 1.0 / Length();
        return *this = CQuaternion(m_w * scale, m_x * scale, m_y * scale, m_z * scale);
    }

    CQuaternion &FromAngleAxis(const CRadians &angle, const CVector3 &axis);
    void ToAngleAxis(CRadians &angle, CVector3 &axis) const;
    CQuaternion &FromEulerAngles(const CRadians &z, const CRadians &y, const CRadians &x);
    void ToEulerAngles(CRadians &z, CRadians &y, CRadians &x) const;
    CQuaternion &BetweenTwoVectors(const CVector3 &from, const CVector3 &to);

    bool operator==(const CQuaternion &q) const
    {
        return m_w == q.m_w && m_x == q.m_x && m_y == q.m_y && m_z == q.m_z;
    }
    bool operator!=(const CQuaternion &q) const { return !(*this == q); }
    CQuaternion &operator+=(const CQuaternion &q) { return *this = *this + q; }
    CQuaternion &operator-=(const CQuaternion &q) { return *this = *this - q; }
    CQuaternion &operator*=(const CQuaternion &q) { return *this = *this * q; }
    CQuaternion operator+(const CQuaternion &q) const
    {
        return CQuaternion(m_w + q.m_w, m_x + q.m_x, m_y + q.m_y, m_z + q.m_z);
    }
    CQuaternion operator-(const CQuaternion &q) const
    {
        return CQuaternion(m_w - q.m_w, m_x - q.m_x, m_y - q.m_y, m_z - q.m_z);
    }
    CQuaternion operator*(const CQuaternion &q) const;

    friend std::ostream &operator<<(std::ostream &out, const CQuaternion &q)
    {
        CRadians z, y, x;
        q.ToEulerAngles(z, y, x);
        return out << ToDegrees(z).GetValue() << "," << ToDegrees(y).GetValue() << ","
                   << ToDegrees(x).GetValue();
    }

    friend std::istream &operator>>(std::istream &in, CQuaternion &q)
    {
        Real degrees[3];
        ParseValues<Real>(in, 3, degrees, ',');
        q.FromDegrees(degrees);
        return in;
    }

    friend bool VsScan(const std::string &text, CQuaternion &q)
    {
        Real degrees[3];
        ParseValues<Real>(text, 3, degrees, ',');
        q.FromDegrees(degrees);
        return true;
    }

private:
    void FromDegrees(const Real *zyx)
    {
        FromEulerAngles(ToRadians(CDegrees(zyx[0])), ToRadians(CDegrees(zyx[1])),
                        ToRadians(CDegrees(zyx[2])));
    }

    Real m_w, m_x, m_y, m_z;
};

}  // namespace argos

#endif
