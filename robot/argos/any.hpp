/* SPDX-License-Identifier: MIT */
/*
 * any.hpp - ARGoS's box for a value of any type, without run-time type information: a type is
 * known by the address of a variable that each type has.
 */
#ifndef VS_ARGOS_ANY_HPP
#define VS_ARGOS_ANY_HPP

#include "exception.hpp"

namespace argos {

class CAny
{
public:
    CAny() : m_held(nullptr) {}
    template <typename T> CAny(const T &value) : m_held(new HeldAs<T>(value)) {}
    CAny(const CAny &other) : m_held(other.m_held ? other.m_held->Clone() : nullptr) {}
    ~CAny() { delete m_held; }

    CAny &operator=(CAny other) { return swap(other); }
    CAny &swap(CAny &other)
    {
        std::swap(m_held, other.m_held);
        return *this;
    }

    /* The value, nullptr: it is of another type. */
    template <typename T> T *VsGet() const
    {
        if (m_held == nullptr || m_held->type != TypeOf<T>())
            return nullptr;
        return &static_cast<HeldAs<T> *>(m_held)->value;
    }

private:
    template <typename T> static const void *TypeOf()
    {
        static const char address = 0;
        return &address;
    }

    struct Held
    {
        const void *const type;

        explicit Held(const void *its_type) : type(its_type) {}
        virtual ~Held() {}
        virtual Held *Clone() const = 0;
    };

    template <typename T> struct HeldAs : Held
    {
        T value;

        explicit HeldAs(const T &from) : Held(TypeOf<T>()), value(from) {}
        Held *Clone() const override { return new HeldAs(value); }
    };

    Held *m_held;
};

template <typename T> T *any_cast(CAny *any)
{
    return any == nullptr ? nullptr : any->VsGet<T>();
}

template <typename T> const T *any_cast(const CAny *any)
{
    return any == nullptr ? nullptr : any->VsGet<T>();
}

template <typename T> T &any_cast(CAny &any)
{
    T *value = any.VsGet<T>();
    if (value == nullptr)
        THROW_ARGOSEXCEPTION("any_cast: the value is of another type than "
                             << __PRETTY_FUNCTION__ << " expects");
    return *value;
}

template <typename T> const T &any_cast(const CAny &any)
{
    return any_cast<T>(const_cast<CAny &>(any));
}

}  // namespace argos

#endif
