/* SPDX-License-Identifier: MIT */
/*
 * types.hpp - ARGoS's names for numbers, and the small functions on them. Everything in
 * namespace `argos` has the name, the arguments and the result that it has in ARGoS 3 (Source:
 * the headers of github.com/ilpincy/argos3 at 421bd76, in src/core/utility); what begins with
 * Vs is ours. Written for C++11 and later, with or without exceptions and RTTI.
 */
#ifndef VS_ARGOS_TYPES_HPP
#define VS_ARGOS_TYPES_HPP

#include <cassert>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <string>
#include <utility>
#include <vector>

#define ARGOS_USE_DOUBLE
#define ARGOS_PI 3.14159265358979323846264338327950288

namespace argos {

typedef double Real;
typedef signed char SInt8;
typedef unsigned char UInt8;
typedef short SInt16;
typedef unsigned short UInt16;
typedef int SInt32;
typedef unsigned int UInt32;
typedef long long SInt64;
typedef unsigned long long UInt64;

/* A byte is written as a number, never as a character. */
inline std::ostream &operator<<(std::ostream &out, const SInt8 value)
{
    return out << static_cast<int>(value);
}

inline std::ostream &operator<<(std::ostream &out, const UInt8 value)
{
    return out << static_cast<unsigned>(value);
}

template <typename T> T Abs(const T &value)
{
    return value > T(0) ? value : value < T(0) ? -value : T(0);
}

inline SInt32 Abs(SInt32 value)
{
    return value < 0 ? -value : value;
}

inline Real Abs(Real value)
{
    return std::fabs(value);
}

template <typename T> T Min(const T &a, const T &b)
{
    return a < b ? a : b;
}

template <typename T> T &Min(T &a, T &b)
{
    return a < b ? a : b;
}

template <typename T> T Max(const T &a, const T &b)
{
    return a > b ? a : b;
}

template <typename T> T &Max(T &a, T &b)
{
    return a > b ? a : b;
}

template <typename T> SInt32 Sign(const T &value)
{
    return (value > T(0)) - (value < T(0));
}

template <typename T> T Square(const T &value)
{
    return value * value;
}

inline Real Log(Real value)
{
    return std::log(value);
}

inline Real Sqrt(Real value)
{
    return std::sqrt(value);
}

inline Real Exp(Real value)
{
    return std::exp(value);
}

inline Real Mod(Real value, Real divisor)
{
    return std::fmod(value, divisor);
}

/* As in ARGoS, a whole number below 0 becomes the next lower one: Floor(-2.0) is -3. */
inline SInt32 Floor(Real value)
{
    const SInt32 whole = static_cast<SInt32>(value);
    return value < 0.0 ? whole - 1 : whole;
}

inline SInt32 Ceil(Real value)
{
    const SInt32 whole = static_cast<SInt32>(value);
    return whole < value ? whole + 1 : whole;
}

inline SInt32 Round(Real value)
{
    return value > 0.0 ? Floor(value + 0.5) : Ceil(value - 0.5);
}

inline SInt32 RoundClosestToZero(Real value)
{
    return value > 0.0 ? Floor(value) : Ceil(value);
}

inline bool DoubleEqAbsolute(Real a, Real b, Real tolerance)
{
    const Real largest = Max<Real>(Abs(a), Abs(b));
    return Abs(a - b) <= tolerance * Max<Real>(1.0, largest);
}

inline bool DoubleEq(Real a, Real b)
{
    return DoubleEqAbsolute(a, b, 0.0001f);
}

/* On the line through the two points around x; points in rising order of x, at least two. */
inline Real Interpolate(Real x, const std::vector<std::pair<Real, Real> > &points)
{
    size_t right = 1;
    while (right + 1 < points.size() && points[right].first < x)
        ++right;
    const std::pair<Real, Real> &a = points[right - 1], &b = points[right];
    const Real dx = a.first - b.first;
    return x * (a.second - b.second) / dx + (a.first * b.second - b.first * a.second) / dx;
}

}  // namespace argos

#endif
