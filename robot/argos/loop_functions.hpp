/* SPDX-License-Identifier: MIT */
/*
 * loop_functions.hpp - ARGoS's loop functions, and the space and the simulator that they see.
 * Names and semantics are ARGoS's (Source: src/core/simulator at 421bd76); what begins with Vs is
 * ours. A host calls them through `vs_cxx_call`.
 */
#ifndef VS_ARGOS_LOOP_FUNCTIONS_HPP
#define VS_ARGOS_LOOP_FUNCTIONS_HPP

#include <stdexcept>

#include "robots.hpp"
#include "plugins.hpp"

/* What a call of the loop functions gives; it is there until the next call. */
struct vs_cxx_answer
{
    const char *text; /* lines, see loop_functions.cpp */
    size_t text_size;
    const unsigned char *colors; /* red, green, blue of each point asked for */
    size_t color_count;
};

/* Calls what the first line of `text` names, of `size` bytes; `numbers`: three for each robot, or
 * two for each point of the floor. */
extern "C" __attribute__((visibility("default"))) void vs_cxx_call(const char *text, size_t size,
                                                                   const double *numbers,
                                                                   size_t count,
                                                                   struct vs_cxx_answer *answer);

namespace argos {

class CLoopFunctions;

class CSpace : public CBaseConfigurableResource
{
public:
    typedef std::map<std::string, CAny, std::less<std::string> > TMapPerType;
    typedef std::map<std::string, TMapPerType, std::less<std::string> > TMapPerTypePerId;
    typedef std::function<void(CControllableEntity *)> TControllableEntityIterCBType;

    CSpace() : m_clock(0) {}
    void Init(TConfigurationNode &) override {}
    void Reset() override {}
    void Destroy() override {}

    UInt32 GetNumberEntities() const { return static_cast<UInt32>(m_entities.size()); }
    CEntity::TVector &GetEntityVector() { return m_entities; }
    CEntity::TVector &GetRootEntityVector() { return m_roots; }
    CEntity::TMap &GetEntityMapPerId() { return m_by_id; }
    TMapPerTypePerId &GetEntityMapPerTypePerId() { return m_by_type; }
    CEntity &GetEntity(const std::string &id);
    void GetEntitiesMatching(CEntity::TVector &found, const std::string &pattern);
    TMapPerType &GetEntitiesByType(const std::string &type);
    CFloorEntity &GetFloorEntity() { return m_floor; }

    UInt32 GetSimulationClock() const { return m_clock; }
    void SetSimulationClock(UInt32 clock) { m_clock = clock; }
    const CVector3 &GetArenaSize() const { return m_size; }
    const CVector3 &GetArenaCenter() const { return m_center; }
    const CRange<CVector3> &GetArenaLimits() const { return m_limits; }
    void IterateOverControllableEntities(const TControllableEntityIterCBType &call);

    void VsSetArena(const CVector3 &size, const CVector3 &center);

    /* ARGoS keeps entities under their own type; a whole brings its parts along. */
    template <typename ENTITY> void AddEntity(ENTITY &entity)
    {
        VsIndex(entity);
        VsIndexAs(entity.GetTypeDescription(), entity.GetId(), CAny(&entity));
    }

    /* Takes it out of all lists, and deletes it. */
    void VsRemove(CEntity &entity);
    /* Whether a body that stood there would stand in another one. */
    bool VsIsFree(const CEmbodiedEntity &body, const CVector3 &at, Real yaw) const;

private:
    void VsIndex(CEntity &entity);
    void VsIndexAs(const std::string &type, const std::string &id, const CAny &entity);

    UInt32 m_clock;
    CVector3 m_size, m_center;
    CRange<CVector3> m_limits;
    CEntity::TVector m_entities, m_roots;
    CEntity::TMap m_by_id;
    TMapPerTypePerId m_by_type;
    std::vector<CEmbodiedEntity *> m_bodies;
    CFloorEntity m_floor;
};

/* Of the physics engines there is the length of a timestep alone. */
class CPhysicsEngine
{
public:
    static Real GetSimulationClockTick() { return VsTick(); }
    static Real GetInverseSimulationClockTick() { return 1.0 / VsTick(); }
    static Real &VsTick();
};

class CSimulator
{
public:
    static CSimulator &GetInstance();

    /* There is one, whatever it is called. */
    CPhysicsEngine &GetPhysicsEngine(const std::string &) { return m_engine; }

    CSpace &GetSpace() { return m_space; }
    CLoopFunctions &GetLoopFunctions();
    TConfigurationNode &GetConfigurationRoot() { return m_root; }
    const std::string &GetExperimentFileName() const { return m_file; }
    UInt32 GetRandomSeed() const { return m_seed; }
    void SetRandomSeed(UInt32 seed) { m_seed = seed; }
    CRandom::CRNG *GetRNG();
    /* What has media here has no need of them. */
    template <typename T> T &GetMedium(const std::string &)
    {
        static T medium;
        return medium;
    }
    UInt32 GetMaxSimulationClock() const { return m_max_clock; }
    UInt32 GetNumThreads() const { return 0; }
    bool IsRealTimeClock() const { return !m_moves_robots; }
    bool IsProfiling() const { return false; }
    void Terminate() { m_terminated = true; }
    bool IsExperimentFinished();

    bool VsMovesRobots() const { return m_moves_robots; }
    bool VsIsTerminated() const { return m_terminated; }
    void VsSet(UInt32 seed, UInt32 max_clock, bool moves_robots, const std::string &file);
    void VsReset();
    /* Goes back to before the first call. */
    void VsForget();

private:
    CSimulator() : m_seed(0), m_max_clock(0), m_moves_robots(false), m_terminated(false) {}

    CSpace m_space;
    CPhysicsEngine m_engine;
    TConfigurationNode m_root;
    std::string m_file;
    CRandom::CRNG *m_rng = nullptr;
    UInt32 m_seed, m_max_clock;
    bool m_moves_robots, m_terminated;
};

class CLoopFunctions : public CBaseConfigurableResource
{
public:
    CLoopFunctions() : m_simulator(CSimulator::GetInstance()) {}

    void Init(TConfigurationNode &) override {}
    void Reset() override {}
    void Destroy() override {}
    virtual void PreStep() {}
    virtual void PostStep() {}
    virtual bool IsExperimentFinished() { return false; }
    virtual void PostExperiment() {}
    virtual CColor GetFloorColor(const CVector2 &) { return CColor::WHITE; }

    CSimulator &GetSimulator() { return m_simulator; }
    CSpace &GetSpace() { return m_simulator.GetSpace(); }
    const CSpace &GetSpace() const { return m_simulator.GetSpace(); }

    virtual void MoveEntity(CPositionalEntity &entity, const CVector3 &position,
                            const CQuaternion &orientation);
    virtual bool MoveEntity(CEmbodiedEntity &entity, const CVector3 &position,
                            const CQuaternion &orientation, bool check_only = false,
                            bool ignore_collisions = false);
    virtual void AddEntity(CEntity &entity);
    virtual void RemoveEntity(const std::string &id);
    virtual void RemoveEntity(CEntity &entity);
    void IterateOverControllableEntities(const CSpace::TControllableEntityIterCBType &call)
    {
        GetSpace().IterateOverControllableEntities(call);
    }

private:
    CSimulator &m_simulator;
};

/*
 * What a mission has reached. ARGoS has no name for it: AutoMoDe's missions and those written after
 * them give it in one of these functions.
 */
#define VS_ARGOS_OBJECTIVE(function)                                                  \
    template <typename T>                                                             \
    auto Vs##function(T &loop, int)->decltype(static_cast<Real>(loop.function()))     \
    {                                                                                 \
        return static_cast<Real>(loop.function());                                    \
    }                                                                                 \
    template <typename T> Real Vs##function(T &, long) { return NAN; }

VS_ARGOS_OBJECTIVE(GetObjectiveFunction)
VS_ARGOS_OBJECTIVE(GetObjectiveFunctionValue)
VS_ARGOS_OBJECTIVE(GetObjective)
VS_ARGOS_OBJECTIVE(GetFitness)
VS_ARGOS_OBJECTIVE(GetScore)
VS_ARGOS_OBJECTIVE(GetPerformance)
#undef VS_ARGOS_OBJECTIVE

/* The first of them that the class shows; not a number: none. */
template <typename T> Real VsObjective(CLoopFunctions &functions)
{
    T &loop = dynamic_cast<T &>(functions);
    const Real values[] = {VsGetObjectiveFunction(loop, 0), VsGetObjectiveFunctionValue(loop, 0),
                           VsGetObjective(loop, 0),         VsGetFitness(loop, 0),
                           VsGetScore(loop, 0),             VsGetPerformance(loop, 0)};
    for (const Real value : values)
        if (!std::isnan(value))
            return value;
    return NAN;
}

template <typename T> CLoopFunctions *VsMakeLoop()
{
    return new T;
}

/* A class of loop functions by its label. */
struct VsLoopKind
{
    const char *label;
    CLoopFunctions *(*make)();
    Real (*objective)(CLoopFunctions &);
    VsLoopKind *next;

    VsLoopKind(const char *its_label, CLoopFunctions *(*makes)(), Real (*gives)(CLoopFunctions &));
};

}  // namespace argos

#define VS_ARGOS_JOINED(a, b) a##b
#define VS_ARGOS_NAMED(number) VS_ARGOS_JOINED(vs_cxx_kind_, number)
#define REGISTER_LOOP_FUNCTIONS(CLASSNAME, LABEL)                                           \
    static ::argos::VsLoopKind VS_ARGOS_NAMED(__COUNTER__)(                                 \
        LABEL, &::argos::VsMakeLoop<CLASSNAME>, &::argos::VsObjective<CLASSNAME>);

#endif
