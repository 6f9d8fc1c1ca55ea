/* SPDX-License-Identifier: MIT */
/*
 * byte_array.hpp - ARGoS's array of bytes: what messages hold. Numbers are written most significant
 * byte first, a floating-point number as 8 bytes of fraction and 4 of exponent, a string with a 0
 * at its end.
 */
#ifndef VS_ARGOS_BYTE_ARRAY_HPP
#define VS_ARGOS_BYTE_ARRAY_HPP

#include <sys/types.h>

#include "exception.hpp"

namespace argos {

class CByteArray
{
public:
    CByteArray() {}
    CByteArray(const UInt8 *bytes, size_t size) { AddBuffer(bytes, size); }
    CByteArray(size_t size, UInt8 value = 0) : m_bytes(size, value) {}

    size_t Size() const { return m_bytes.size(); }
    bool Empty() const { return m_bytes.empty(); }
    void Resize(size_t size, UInt8 value = 0) { m_bytes.resize(size, value); }
    void Swap(CByteArray &other) { m_bytes.swap(other.m_bytes); }
    void Clear() { m_bytes.clear(); }
    void Zero() { m_bytes.assign(Size(), 0); }
    const UInt8 *ToCArray() const { return Empty() ? nullptr : m_bytes.data(); }
    UInt8 *ToCArray() { return Empty() ? nullptr : m_bytes.data(); }

    UInt8 &operator[](size_t index)
    {
        if (index >= Size())
            THROW_ARGOSEXCEPTION("CByteArray: index out of bounds [index = "
                                 << index << ", size=" << Size() << "]");
        return m_bytes[index];
    }
    UInt8 operator[](size_t index) const { return const_cast<CByteArray &>(*this)[index]; }

    bool operator==(const CByteArray &other) const { return m_bytes == other.m_bytes; }
    bool operator!=(const CByteArray &other) const { return !(*this == other); }

    CByteArray &AddBuffer(const UInt8 *bytes, size_t size);
    /* Takes bytes from the front. */
    CByteArray &FetchBuffer(UInt8 *bytes, size_t size);
    /* A new array of the bytes from start to before end, up to the last with an end below 0; the
     * caller owns it. */
    CByteArray *operator()(size_t start, ssize_t end = -1);

    template <typename T> T PopFront()
    {
        T value;
        *this >> value;
        return value;
    }

    CByteArray &operator<<(UInt8 value) { return Put(value, 1); }
    CByteArray &operator<<(SInt8 value) { return Put(static_cast<UInt8>(value), 1); }
    CByteArray &operator<<(UInt16 value) { return Put(value, 2); }
    CByteArray &operator<<(SInt16 value) { return Put(static_cast<UInt16>(value), 2); }
    CByteArray &operator<<(UInt32 value) { return Put(value, 4); }
    CByteArray &operator<<(SInt32 value) { return Put(static_cast<UInt32>(value), 4); }
    CByteArray &operator<<(UInt64 value) { return Put(value, 8); }
    CByteArray &operator<<(SInt64 value) { return Put(static_cast<UInt64>(value), 8); }
    CByteArray &operator<<(unsigned long value) { return Put(value, sizeof value); }
    CByteArray &operator<<(long value)
    {
        return Put(static_cast<unsigned long>(value), sizeof value);
    }
    CByteArray &operator<<(float value) { return *this << static_cast<double>(value); }
    CByteArray &operator<<(double value);
    CByteArray &operator<<(const std::string &value);

    CByteArray &operator>>(UInt8 &value) { return TakeAs(value); }
    CByteArray &operator>>(SInt8 &value) { return TakeAs(value); }
    CByteArray &operator>>(UInt16 &value) { return TakeAs(value); }
    CByteArray &operator>>(SInt16 &value) { return TakeAs(value); }
    CByteArray &operator>>(UInt32 &value) { return TakeAs(value); }
    CByteArray &operator>>(SInt32 &value) { return TakeAs(value); }
    CByteArray &operator>>(UInt64 &value) { return TakeAs(value); }
    CByteArray &operator>>(SInt64 &value) { return TakeAs(value); }
    CByteArray &operator>>(unsigned long &value) { return TakeAs(value); }
    CByteArray &operator>>(long &value) { return TakeAs(value); }
    CByteArray &operator>>(float &value)
    {
        double wide;
        *this >> wide;
        value = static_cast<float>(wide);
        return *this;
    }
    CByteArray &operator>>(double &value);
    CByteArray &operator>>(std::string &value);

    friend std::ostream &operator<<(std::ostream &out, const CByteArray &array)
    {
        out << "CByteArray [";
        for (size_t i = 0; i < array.Size(); ++i)
            out << " " << static_cast<unsigned>(array.m_bytes[i]);
        return out << " ]" << std::endl;
    }

private:
    CByteArray &Put(UInt64 value, size_t size);
    UInt64 Take(size_t size);

    template <typename T> CByteArray &TakeAs(T &value)
    {
        value = static_cast<T>(Take(sizeof value));
        return *this;
    }

    std::vector<UInt8> m_bytes;
};

}  // namespace argos

#endif
