/* SPDX-License-Identifier: MIT */
/*
 * color.hpp - ARGoS's colours: red, green, blue and opacity, 0..255 each.
 */
#ifndef VS_ARGOS_COLOR_HPP
#define VS_ARGOS_COLOR_HPP

#include "text.hpp"

namespace argos {

class CColor
{
public:
    static CColor BLACK, WHITE, RED, GREEN, BLUE, MAGENTA, CYAN, YELLOW, ORANGE, BROWN, PURPLE,
        GRAY10, GRAY20, GRAY30, GRAY40, GRAY50, GRAY60, GRAY70, GRAY80, GRAY90;

    constexpr CColor() : m_red(0), m_green(0), m_blue(0), m_alpha(255) {}
    constexpr explicit CColor(UInt8 red, UInt8 green, UInt8 blue, UInt8 alpha = 255)
        : m_red(red), m_green(green), m_blue(blue), m_alpha(alpha)
    {
    }

    Real ToGrayScale() const { return 0.299f * m_red + 0.587f * m_green + 0.114f * m_blue; }

    UInt8 GetRed() const { return m_red; }
    UInt8 GetGreen() const { return m_green; }
    UInt8 GetBlue() const { return m_blue; }
    UInt8 GetAlpha() const { return m_alpha; }
    void SetRed(UInt8 red) { m_red = red; }
    void SetGreen(UInt8 green) { m_green = green; }
    void SetBlue(UInt8 blue) { m_blue = blue; }
    void SetAlpha(UInt8 alpha) { m_alpha = alpha; }
    void Set(UInt8 red, UInt8 green, UInt8 blue, UInt8 alpha = 255)
    {
        *this = CColor(red, green, blue, alpha);
    }

    /* A name, or "red,green,blue,alpha". */
    void Set(const std::string &text);

    /* Laid over another colour as its opacity says. */
    CColor Blend(const CColor &below) const
    {
        const Real over = m_alpha / 255.0, under = 1.0 - over;
        return CColor(static_cast<UInt8>(over * m_red + under * below.m_red),
                      static_cast<UInt8>(over * m_green + under * below.m_green),
                      static_cast<UInt8>(over * m_blue + under * below.m_blue));
    }

    operator UInt32() const
    {
        UInt32 bits;
        std::memcpy(&bits, this, sizeof bits);
        return bits;
    }

    bool operator==(const CColor &c) const
    {
        return m_red == c.m_red && m_green == c.m_green && m_blue == c.m_blue &&
               m_alpha == c.m_alpha;
    }
    bool operator!=(const CColor &c) const { return !(*this == c); }

    /* Its name, or its four numbers. */
    std::string VsName() const;

    friend std::ostream &operator<<(std::ostream &out, const CColor &color)
    {
        return out << color.VsName();
    }

    friend std::istream &operator>>(std::istream &in, CColor &color)
    {
        std::string text;
        in >> text;
        color.Set(text);
        return in;
    }

    friend bool VsScan(const std::string &text, CColor &color)
    {
        color.Set(text);
        return true;
    }

private:
    UInt8 m_red, m_green, m_blue, m_alpha;
};

}  // namespace argos

#endif
