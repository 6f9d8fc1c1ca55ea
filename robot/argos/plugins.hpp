/* SPDX-License-Identifier: MIT */
/*
 * plugins.hpp - classes by their labels, as ARGoS's plug-ins register them (Source: how
 * REGISTER_SYMBOL, CFactory and CDynamicLoading are used; github.com/ilpincy/argos3 at 421bd76).
 * All that is compiled together is registered when it is loaded: no library is opened at run time.
 */
#ifndef VS_ARGOS_PLUGINS_HPP
#define VS_ARGOS_PLUGINS_HPP

#include <iostream>

#include "exception.hpp"
#include "log.hpp"

namespace argos {

template <typename TYPE> class CFactory
{
public:
    typedef TYPE *TCreator();

    struct STypeInfo
    {
        TCreator *Creator;
        std::string Author, Version, BriefDescription, LongDescription, Status;
    };

    typedef std::map<std::string, STypeInfo *> TTypeMap;

    static TTypeMap &GetTypeMap()
    {
        static TTypeMap map;
        return map;
    }

    static void Register(const std::string &label, const std::string &author,
                         const std::string &version, const std::string &brief,
                         const std::string &details, const std::string &status, TCreator *creator)
    {
        STypeInfo *&known = GetTypeMap()[label];
        delete known;
        known = new STypeInfo{creator, author, version, brief, details, status};
    }

    static bool Exists(const std::string &label) { return GetTypeMap().count(label) > 0; }

    /* Throws where nothing of that label was compiled. */
    static TYPE *New(const std::string &label)
    {
        const typename TTypeMap::const_iterator found = GetTypeMap().find(label);
        if (found != GetTypeMap().end())
            return found->second->Creator();
        std::string known;
        for (const auto &each : GetTypeMap())
            known += (known.empty() ? "\"" : ", \"") + each.first + "\"";
        THROW_ARGOSEXCEPTION("Symbol \"" << label << "\" not found; there are: "
                             << (known.empty() ? "none" : known)
                             << ". What a library registers that is loaded at run time is there if"
                                " its sources are named, too, with --sources");
    }

    static void Print(std::ostream &out)
    {
        out << "Symbols:" << std::endl;
        for (const auto &each : GetTypeMap())
            out << each.first << " (" << each.second->BriefDescription << ")" << std::endl;
    }

    static void Destroy()
    {
        for (const auto &each : GetTypeMap())
            delete each.second;
        GetTypeMap().clear();
    }
};

class CDynamicLoading
{
public:
    typedef void *TDLHandle;

    /* Nothing is opened; see CFactory::New for what is then not there. */
    static TDLHandle LoadLibrary(const std::string &) { return nullptr; }
    static void UnloadLibrary(const std::string &) {}
    static void LoadAllLibraries() {}
    static void UnloadAllLibraries() {}
};

}  // namespace argos

#define VS_ARGOS_SYMBOL_NAME(base, name) vs_symbol_##base##_##name
#define REGISTER_SYMBOL(BASECLASS, CLASSNAME, LABEL, AUTHOR, VERSION, BRIEF, DETAILS, STATUS)     \
    namespace argos {                                                                             \
    namespace {                                                                                   \
    struct VS_ARGOS_SYMBOL_NAME(BASECLASS, CLASSNAME)                                             \
    {                                                                                             \
        VS_ARGOS_SYMBOL_NAME(BASECLASS, CLASSNAME)()                                              \
        {                                                                                         \
            CFactory<BASECLASS>::Register(LABEL, AUTHOR, VERSION, BRIEF, DETAILS, STATUS, &Make); \
        }                                                                                         \
        static BASECLASS *Make() { return new CLASSNAME; }                                        \
    } VS_ARGOS_SYMBOL_NAME(BASECLASS##_, CLASSNAME##_);                                           \
    }                                                                                             \
    }

#endif
