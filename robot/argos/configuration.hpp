/* SPDX-License-Identifier: MIT */
/*
 * configuration.hpp - the tree of settings that ARGoS gives to Init, and the functions that read
 * it. ARGoS's tree is that of ticpp, an XML library, so the names of that namespace are here as far
 * as users write them; there is no XML behind them.
 */
#ifndef VS_ARGOS_CONFIGURATION_HPP
#define VS_ARGOS_CONFIGURATION_HPP

#include "text.hpp"

namespace ticpp {

class Exception : public argos::CARGoSException
{
public:
    explicit Exception(const std::string &details)
        : argos::CARGoSException(details), m_details(details)
    {
    }
    ~Exception() noexcept override {}

    std::string m_details;
};

class Attribute
{
public:
    explicit Attribute(const std::string &name = "", const std::string &value = "")
        : m_name(name), m_value(value)
    {
    }

    const std::string &Name() const { return m_name; }
    const std::string &Value() const { return m_value; }
    template <typename T> void GetName(T *name) const { argos::VsScan(m_name, *name); }
    template <typename T> void GetValue(T *value) const { argos::VsScan(m_value, *value); }
    template <typename T> void SetValue(const T &value) { m_value = argos::ToString(value); }

private:
    std::string m_name, m_value;
};

/* A handle of a node: copies mean the same node, which lives as long as one of them. */
class Element
{
public:
    Element();
    explicit Element(const std::string &name);
    Element(const Element &other);
    Element &operator=(const Element &other);
    virtual ~Element();

    const std::string &Value() const;
    void SetValue(const std::string &name);
    /* The attribute's text, nullptr: there is none. */
    const std::string *VsFind(const std::string &name) const;
    bool HasAttribute(const std::string &name) const { return VsFind(name) != nullptr; }
    std::string GetAttribute(const std::string &name) const;
    std::string GetAttributeOrDefault(const std::string &name, const std::string &other) const;
    const std::string &VsText() const;
    void SetText(const std::string &text);
    void VsSet(const std::string &name, const std::string &value);

    template <typename T>
    void GetAttribute(const std::string &name, T *value, bool must_be = true) const
    {
        const std::string *text = VsFind(name);
        if (text == nullptr && must_be)
            VsMissing(name);
        if (text != nullptr && !VsRead(*text, *value))
            VsWrong(name, *text);
    }

    template <typename T, typename Other>
    void GetAttributeOrDefault(const std::string &name, T *value, const Other &other) const
    {
        if (HasAttribute(name))
            GetAttribute(name, value);
        else
            *value = other;
    }

    template <typename T> void SetAttribute(const std::string &name, const T &value)
    {
        VsSet(name, argos::ToString(value));
    }

    std::string GetText(bool must_be = true) const;
    std::string GetTextOrDefault(const std::string &other) const;

    template <typename T> void GetText(T *value, bool must_be = true) const
    {
        const std::string text = GetText(must_be);
        if (!text.empty() && !VsRead(text, *value))
            VsWrong("", text);
    }

    template <typename T, typename Other>
    void GetTextOrDefault(T *value, const Other &other) const
    {
        *value = other;
        GetText(value, false);
    }

    /* The first child, of this name if one is given; nullptr or an exception: there is none. */
    Element *FirstChildElement(const std::string &name, bool must_be = true) const;
    Element *FirstChildElement(bool must_be = true) const { return FirstChildElement("", must_be); }
    /* Appends a copy of a node with everything below it. */
    Element *InsertEndChild(const Element &child);

    /* What iterators walk along. */
    const std::vector<Element *> &VsList(const Element *) const;
    const std::vector<Attribute *> &VsList(const Attribute *) const;

    friend std::ostream &operator<<(std::ostream &out, const Element &element);

private:
    struct Node;

    template <typename T> static bool VsRead(const std::string &text, T &value)
    {
        using argos::VsScan;
        return VsScan(text, value);
    }
    static bool VsRead(const std::string &text, bool &value);
    [[noreturn]] void VsMissing(const std::string &name) const;
    [[noreturn]] void VsWrong(const std::string &name, const std::string &text) const;
    void VsRelease();

    Node *m_node;
};

/* Walks along the children or the attributes of an element; those of one name, if it has one. */
template <class T> class Iterator
{
public:
    Iterator(const std::string &name = "") : m_name(name), m_list(nullptr), m_index(0) {}

    Iterator begin(const Element *parent) const
    {
        Iterator first(m_name);
        first.m_list = &parent->VsList(static_cast<T *>(nullptr));
        first.Settle();
        return first;
    }

    Iterator end() const { return Iterator(m_name); }

    Iterator &operator++()
    {
        ++m_index;
        Settle();
        return *this;
    }

    Iterator operator++(int)
    {
        Iterator before(*this);
        ++*this;
        return before;
    }

    T *Get() const { return m_list == nullptr ? nullptr : (*m_list)[m_index]; }
    T *operator->() const { return Get(); }
    T &operator*() const { return *Get(); }
    bool operator==(const T *other) const { return Get() == other; }
    bool operator!=(const T *other) const { return Get() != other; }
    bool operator==(const Iterator &other) const { return Get() == other.Get(); }
    bool operator!=(const Iterator &other) const { return Get() != other.Get(); }

private:
    static const std::string &NameOf(const Element &element) { return element.Value(); }
    static const std::string &NameOf(const Attribute &attribute) { return attribute.Name(); }

    /* Goes on to what it is to show; without a list there is nothing more. */
    void Settle()
    {
        while (m_list != nullptr && m_index < m_list->size() && !m_name.empty() &&
               NameOf(*(*m_list)[m_index]) != m_name)
            ++m_index;
        if (m_list != nullptr && m_index >= m_list->size())
            m_list = nullptr;
    }

    std::string m_name;
    const std::vector<T *> *m_list;
    size_t m_index;
};

}  // namespace ticpp

namespace argos {

typedef ticpp::Element TConfigurationNode;
typedef ticpp::Iterator<ticpp::Element> TConfigurationNodeIterator;
typedef ticpp::Iterator<ticpp::Attribute> TConfigurationAttributeIterator;

/*
 * Makes a tree of the host's form of it. Each line is one of: "<NAME" opens a node, "@NAME=TEXT"
 * is an attribute of the open one, "#TEXT" its text, ">" closes it; in texts "\n" and "\\" stand
 * for a new line and a backslash.
 */
TConfigurationNode VsReadConfiguration(const std::string &lines);

inline bool NodeExists(TConfigurationNode &node, const std::string &tag)
{
    return node.FirstChildElement(tag, false) != nullptr;
}

inline TConfigurationNode &GetNode(TConfigurationNode &node, const std::string &tag)
{
    TConfigurationNode *found = node.FirstChildElement(tag, false);
    if (found == nullptr)
        THROW_ARGOSEXCEPTION("Node '" << tag << "' not found in <" << node.Value() << ">");
    return *found;
}

inline void AddChildNode(TConfigurationNode &parent, TConfigurationNode &child)
{
    parent.InsertEndChild(child);
}

template <typename T> void GetNodeText(TConfigurationNode &node, T &value)
{
    node.GetText(&value);
}

template <typename T>
void GetNodeTextOrDefault(TConfigurationNode &node, T &value, const T &other)
{
    node.GetTextOrDefault(&value, other);
}

inline bool NodeAttributeExists(TConfigurationNode &node, const std::string &name)
{
    return node.HasAttribute(name);
}

template <typename T>
void GetNodeAttribute(TConfigurationNode &node, const std::string &name, T &value)
{
    node.GetAttribute(name, &value, true);
}

template <typename T>
void GetNodeAttributeOrDefault(TConfigurationNode &node, const std::string &name, T &value,
                               const T &other)
{
    node.GetAttributeOrDefault(name, &value, other);
}

/* These three take defaults that are no constant of their type, such as a plain 0. */
inline void GetNodeAttributeOrDefault(TConfigurationNode &node, const std::string &name,
                                      bool &value, const bool other)
{
    node.GetAttributeOrDefault(name, &value, other);
}

inline void GetNodeAttributeOrDefault(TConfigurationNode &node, const std::string &name,
                                      UInt8 &value, const UInt8 other)
{
    node.GetAttributeOrDefault(name, &value, other);
}

inline void GetNodeAttributeOrDefault(TConfigurationNode &node, const std::string &name,
                                      SInt8 &value, const SInt8 other)
{
    node.GetAttributeOrDefault(name, &value, other);
}

template <typename T>
void SetNodeAttribute(TConfigurationNode &node, const std::string &name, const T &value)
{
    node.SetAttribute(name, value);
}

/* What all that has settings has. */
class CBaseConfigurableResource
{
public:
    virtual ~CBaseConfigurableResource() {}
    virtual void Init(TConfigurationNode &tree) = 0;
    virtual void Reset() = 0;
    virtual void Destroy() = 0;
};

}  // namespace argos

#endif
