/* SPDX-License-Identifier: MIT */
/*
 * rays.hpp - ARGoS's rays, which are segments: from a start to an end (Source: what CRay2 and CRay3
 * give, github.com/ilpincy/argos3 at 421bd76). A `t` on a ray is 0 at its start, 1 at its end.
 */
#ifndef VS_ARGOS_RAYS_HPP
#define VS_ARGOS_RAYS_HPP

#include "quaternion.hpp"

namespace argos {

/* What rays in the plane and in space have in common. */
template <typename VECTOR> class VsRay
{
public:
    VsRay() {}
    VsRay(const VECTOR &start, const VECTOR &end) : m_start(start), m_end(end) {}
    VsRay(const VECTOR &start, const VECTOR &direction, Real length) { Set(start, direction, length); }

    const VECTOR &GetStart() const { return m_start; }
    const VECTOR &GetEnd() const { return m_end; }
    VECTOR &GetStart() { return m_start; }
    VECTOR &GetEnd() { return m_end; }
    void SetStart(const VECTOR &start) { m_start = start; }
    void SetEnd(const VECTOR &end) { m_end = end; }
    void Set(const VECTOR &start, const VECTOR &end)
    {
        m_start = start;
        m_end = end;
    }
    /* `direction`: of length 1. */
    void Set(const VECTOR &start, const VECTOR &direction, Real length)
    {
        Set(start, start + direction * length);
    }

    Real GetLength() const { return Along().Length(); }
    /* From the start to a `t`. */
    Real GetDistance(Real t) const { return (Along() * t).Length(); }
    void GetPoint(VECTOR &point, Real t) const { point = m_start + Along() * t; }
    void GetDirection(VECTOR &direction) const { direction = Along().Normalize(); }
    void GetInverseDirection(VECTOR &direction) const { direction = (-Along()).Normalize(); }
    VECTOR &ToVector(VECTOR &vector) const { return vector = Along(); }

    friend std::ostream &operator<<(std::ostream &out, const VsRay &ray)
    {
        return out << ray.m_start << " -> " << ray.m_end;
    }

protected:
    VECTOR Along() const { return m_end - m_start; }

private:
    VECTOR m_start, m_end;
};

class CRay2 : public VsRay<CVector2>
{
public:
    using VsRay<CVector2>::VsRay;

    /*
     * What ARGoS answers, which is not always whether two segments meet: it does not divide the
     * place on this ray by the rays' cross product. Published results were made with it.
     */
    bool Intersects(const CRay2 &other) const
    {
        const Real limit = 1e-4;
        const CVector2 along = Along(), others = other.Along();
        const CVector2 apart = GetStart() - other.GetStart();
        const Real place = Cross(apart, others);
        if (Abs(Cross(along, others)) < limit || place < 0.0 || place > 1.0)
            return false;
        const Real on_other = Abs(others.GetY()) > limit
                                  ? apart.GetY() + along.GetY() * place / others.GetY()
                                  : apart.GetX() + along.GetX() * place / others.GetX();
        return on_other >= 0.0 && on_other <= 1.0;
    }

private:
    static Real Cross(const CVector2 &a, const CVector2 &b)
    {
        return a.GetX() * b.GetY() - a.GetY() * b.GetX();
    }
};

class CRay3 : public VsRay<CVector3>
{
public:
    using VsRay<CVector3>::VsRay;

    void SetLength(Real length)
    {
        CVector3 direction;
        GetDirection(direction);
        Set(GetStart(), direction, length);
    }
};

}  // namespace argos

#endif
