/* SPDX-License-Identifier: MIT */
/*
 * configuration.cpp - the tree of settings: see configuration.hpp.
 */
#include "configuration.hpp"

namespace ticpp {

/* Counted by hand: a shared pointer counts with atomics, which ARMv5 has none of. */
struct Element::Node
{
    std::string name, text;
    std::vector<Attribute *> attributes;
    std::vector<Element *> children;
    unsigned handles;

    explicit Node(const std::string &its_name) : name(its_name), handles(1) {}

    ~Node()
    {
        for (Attribute *attribute : attributes)
            delete attribute;
        for (Element *child : children)
            delete child;
    }
};

namespace {

/* Users catch either kind of exception: this one is both. */
[[noreturn]] void Fail(const std::string &what)
{
#if VS_ARGOS_EXCEPTIONS
    throw Exception(what);
#else
    argos::VsThrow(what);
#endif
}

}  // namespace

Element::Element() : m_node(new Node("")) {}

Element::Element(const std::string &name) : m_node(new Node(name)) {}

Element::Element(const Element &other) : m_node(other.m_node)
{
    ++m_node->handles;
}

Element &Element::operator=(const Element &other)
{
    ++other.m_node->handles;
    VsRelease();
    m_node = other.m_node;
    return *this;
}

Element::~Element()
{
    VsRelease();
}

void Element::VsRelease()
{
    if (--m_node->handles == 0)
        delete m_node;
}

const std::string &Element::Value() const
{
    return m_node->name;
}

void Element::SetValue(const std::string &name)
{
    m_node->name = name;
}

const std::string *Element::VsFind(const std::string &name) const
{
    for (const Attribute *attribute : m_node->attributes)
        if (attribute->Name() == name)
            return &attribute->Value();
    return nullptr;
}

std::string Element::GetAttribute(const std::string &name) const
{
    return GetAttributeOrDefault(name, "");
}

std::string Element::GetAttributeOrDefault(const std::string &name, const std::string &other) const
{
    const std::string *text = VsFind(name);
    return text == nullptr ? other : *text;
}

void Element::VsSet(const std::string &name, const std::string &value)
{
    for (Attribute *attribute : m_node->attributes)
        if (attribute->Name() == name) {
            attribute->SetValue(value);
            return;
        }
    m_node->attributes.push_back(new Attribute(name, value));
}

const std::string &Element::VsText() const
{
    return m_node->text;
}

void Element::SetText(const std::string &text)
{
    m_node->text = text;
}

std::string Element::GetText(bool must_be) const
{
    if (must_be && m_node->text.empty())
        Fail("<" + m_node->name + "> has no text");
    return m_node->text;
}

std::string Element::GetTextOrDefault(const std::string &other) const
{
    return m_node->text.empty() ? other : m_node->text;
}

Element *Element::FirstChildElement(const std::string &name, bool must_be) const
{
    for (Element *child : m_node->children)
        if (name.empty() || child->Value() == name)
            return child;
    if (must_be)
        Fail("<" + m_node->name + "> has no element <" + name + "> in it");
    return nullptr;
}

Element *Element::InsertEndChild(const Element &child)
{
    Element *copy = new Element(child.Value());
    copy->SetText(child.VsText());
    for (const Attribute *attribute : child.m_node->attributes)
        copy->VsSet(attribute->Name(), attribute->Value());
    for (const Element *below : child.m_node->children)
        copy->InsertEndChild(*below);
    m_node->children.push_back(copy);
    return copy;
}

const std::vector<Element *> &Element::VsList(const Element *) const
{
    return m_node->children;
}

const std::vector<Attribute *> &Element::VsList(const Attribute *) const
{
    return m_node->attributes;
}

bool Element::VsRead(const std::string &text, bool &value)
{
    value = text == "true";
    return value || text == "false";
}

void Element::VsMissing(const std::string &name) const
{
    Fail("Error parsing attribute \"" + name + "\": <" + m_node->name + "> has none");
}

void Element::VsWrong(const std::string &name, const std::string &text) const
{
    const std::string what = name.empty() ? "the text" : "attribute \"" + name + "\"";
    Fail("Error parsing " + what + " of <" + m_node->name + ">: \"" + text +
                   "\" is no value of the type expected");
}

std::ostream &operator<<(std::ostream &out, const Element &element)
{
    out << "<" << element.Value();
    for (const Attribute *attribute : element.m_node->attributes)
        out << " " << attribute->Name() << "=\"" << attribute->Value() << "\"";
    out << ">" << element.VsText();
    for (const Element *child : element.m_node->children)
        out << *child;
    return out << "</" << element.Value() << ">";
}

}  // namespace ticpp

namespace argos {

namespace {

std::string Unescaped(const std::string &text)
{
    std::string plain;
    for (size_t i = 0; i < text.size(); ++i) {
        const bool is_escape = text[i] == '\\' && i + 1 < text.size();
        if (is_escape)
            ++i;
        plain += is_escape && text[i] == 'n' ? '\n' : text[i];
    }
    return plain;
}

}  // namespace

TConfigurationNode VsReadConfiguration(const std::string &lines)
{
    TConfigurationNode top;
    std::vector<TConfigurationNode *> open(1, &top);
    for (const std::string &line : VsParts(lines, '\n')) {
        const std::string rest = line.substr(std::min<size_t>(1, line.size()));
        const size_t equals = std::min(rest.find('='), rest.size());
        if (line[0] == '<')
            open.push_back(open.back()->InsertEndChild(TConfigurationNode(rest)));
        else if (line[0] == '@' && equals < rest.size())
            open.back()->VsSet(rest.substr(0, equals), Unescaped(rest.substr(equals + 1)));
        else if (line[0] == '#')
            open.back()->SetText(Unescaped(rest));
        else if (line[0] == '>' && open.size() > 1)
            open.pop_back();
    }
    const TConfigurationNode *first = top.FirstChildElement(false);
    return first == nullptr ? top : *first;
}

}  // namespace argos
