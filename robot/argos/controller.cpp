/* SPDX-License-Identifier: MIT */
/*
 * controller.cpp - the daemon's `vs_controller` made of a class that derives from CCI_Controller:
 * the one that VS_ARGOS_LABEL names, "" the only one; people read VS_ARGOS_NAME. Order of the calls as in ARGoS: constructor, Init, then in
 * every control step all sensors, ControlStep, all actuators; at the end Destroy and the
 * destructor. Reset is called in no run: each begins with a new object.
 */
#include "controller.hpp"

#include "../layer.h"

#ifdef VS_ARGOS_TOGETHER
#include "entities.hpp"
#endif

#if !VS_ARGOS_EXCEPTIONS
#include <csetjmp>
#endif

namespace argos {

namespace {

const char SENSORS[] = "vs:sensors";
const char ACTUATORS[] = "vs:actuators";
const size_t PARAM_BYTES = 4096 + 1;

struct State
{
    CCI_Controller *controller;
    void *memory; /* that it lies in */
    TConfigurationNode *params;
};

#ifdef VS_ARGOS_TOGETHER
struct Running
{
    State *state;
    vs_robot *robot;
};

/* Every robot's controller, by the robot's id. */
std::map<std::string, Running> &AllRunning()
{
    static std::map<std::string, Running> all;
    return all;
}
#endif

/* Whose turn it is: one process may run many robots, one after the other. */
vs_robot *s_robot;

/* In a control step: who asks for a sensor then finds this step's readings. */
bool s_is_step;

#if !VS_ARGOS_EXCEPTIONS
/* Where vs_argos_fail goes, which cannot return. */
std::jmp_buf s_way_out;
#endif

/* The line of a parameter that the host adds, without its name; "" if there is none. */
std::string HostParam(const char *name)
{
    char text[PARAM_BYTES];
    return vs_robot_param_text(s_robot, name, text, sizeof text) < 0 ? "" : text;
}

bool IsDeclared(const char *section, const std::string &element)
{
    const std::string all = " " + HostParam(section) + " ";
    return all.find(" " + element + " ") != std::string::npos;
}

/* The tree of <params>: the host sends it in lines that VsReadConfiguration knows, each with a "="
 * behind its first character. */
TConfigurationNode *ReadParams()
{
    std::string lines;
    for (const std::string &line : VsParts(vs_robot_params(s_robot), '\n'))
        if (line[0] == '@')
            lines += line + "\n";
        else if (line.find_first_of("<>#") == 0)
            lines += line.substr(0, 1) + line.substr(2) + "\n";
    return new TConfigurationNode(VsReadConfiguration(lines));
}

const VsRegistered *Registered()
{
    const std::string label = VS_ARGOS_LABEL;
    const VsRegistered *only = VsRegistered::First();
    std::string known;
    for (const VsRegistered *one = only; one != nullptr; one = one->Next()) {
        if (one->Label() == label)
            return one;
        known += (known.empty() ? "'" : ", '") + one->Label() + "'";
    }
    if (label.empty() && only != nullptr && only->Next() == nullptr)
        return only;
    VsThrow("no REGISTER_CONTROLLER is for '" + label + "'; there are: " +
            (known.empty() ? "none" : known));
}

void Begin(State *state)
{
    const UInt32 seed = static_cast<UInt32>(vs_robot_random(s_robot) * 4294967296.0);
    if (!CRandom::CreateCategory("argos", seed))
        CRandom::GetCategory("argos").VsRestart(seed);
    const VsRegistered *registered = Registered();
    /* Zeros, as new memory of a process is: controllers rely on it. */
    state->memory = std::calloc(1, registered->Size());
    if (state->memory == nullptr)
        VsThrow("no memory left");
    state->controller = registered->Make(state->memory);
    state->controller->SetId(HostParam("vs:id"));
    state->params = ReadParams();
#ifdef VS_ARGOS_TOGETHER
    AllRunning()[state->controller->GetId()] = Running{state, s_robot};
#endif
    state->controller->Init(*state->params);
}

void Step(State *state)
{
    for (const auto &sensor : state->controller->GetAllSensors())
        if (sensor.second->IsEnabled())
            sensor.second->VsUpdate(s_robot);
    s_is_step = true;
    state->controller->ControlStep();
    for (const auto &actuator : state->controller->GetAllActuators())
        actuator.second->VsUpdate(s_robot);
}

void End(State *state)
{
    CCI_Controller *controller = state->controller;
    state->controller = nullptr;
    if (controller == nullptr)
        return;
#ifdef VS_ARGOS_TOGETHER
    AllRunning().erase(controller->GetId());
#endif
    controller->Destroy();
    controller->~CCI_Controller();
    std::free(state->memory);
    delete state->params;
}

/* Calls one of these three; what it throws ends the controller. Without exceptions nothing is
 * unwound: what the controller had stays as it is, and nobody touches it again. */
void Call(void (*function)(State *), void *state, vs_robot *robot)
{
    State *own = static_cast<State *>(state);
    s_robot = robot;
    s_is_step = false;
#if VS_ARGOS_EXCEPTIONS
    try {
        function(own);
    } catch (const std::exception &error) {
        own->controller = nullptr;
        vs_robot_fail(robot, error.what());
    } catch (...) {
        own->controller = nullptr;
        vs_robot_fail(robot, "the controller threw something that is no std::exception");
    }
#else
    if (setjmp(s_way_out) == 0)
        function(own);
    else
        own->controller = nullptr;
#endif
    LOG.Flush();
    LOGERR.Flush();
}

void InitState(void *state, vs_robot *robot)
{
    Call(Begin, state, robot);
}

void StepState(void *state, vs_robot *robot)
{
    Call(Step, state, robot);
}

void EndState(void *state, vs_robot *robot)
{
    Call(End, state, robot);
}

}  // namespace

const VsRegistered *VsRegistered::s_first;

VsRegistered::VsRegistered(const std::string &label, size_t size, Maker make)
    : m_label(label), m_size(size), m_make(make), m_next(s_first)
{
    s_first = this;
}

CCI_Controller::CCI_Controller() {}

CCI_Controller::~CCI_Controller()
{
    for (const auto &sensor : m_mapSensors)
        delete sensor.second;
    for (const auto &actuator : m_mapActuators)
        delete actuator.second;
}

bool CCI_Controller::HasSensor(const std::string &element) const
{
    return IsDeclared(SENSORS, element);
}

bool CCI_Controller::HasActuator(const std::string &element) const
{
    return IsDeclared(ACTUATORS, element);
}

size_t VsCountOf(vs_robot *robot, const char *param, size_t usual)
{
    return static_cast<size_t>(vs_robot_param(robot, param, static_cast<double>(usual)));
}

bool CCI_Sensor::VsBind(vs_robot *robot, const std::string &, const char *name)
{
    m_handle = vs_robot_sensor(robot, name);
    return m_handle >= 0;
}

namespace {

/* Makes a device that the controller asks for the first time. */
VsDevice *Make(const char *kind_name, const char *section, const std::string &element,
               const VsDevice::Kind &kind)
{
    const char *name = kind.name_of(element);
    if (!IsDeclared(section, element))
        THROW_ARGOSEXCEPTION("Unknown " << kind_name << " type " << element << " requested in "
                             "controller. Did you add it to the XML file?");
    if (name == nullptr)
        THROW_ARGOSEXCEPTION("The " << kind_name << " <" << element << "> is of another class than "
                             "the controller asks for");
    VsDevice *device = kind.make();
    device->VsBecome(kind);
    if (!device->VsBind(s_robot, element, name)) {
        delete device;
        THROW_ARGOSEXCEPTION("The " << kind_name << " <" << element << "> is not there: nobody "
                             "offers '" << name << "' to this robot");
    }
    if (s_is_step && section == SENSORS && device->IsEnabled())
        device->VsUpdate(s_robot);
    return device;
}

template <typename Map, typename Device>
Device *Find(Map &map, const char *kind_name, const char *section, const std::string &element,
             const VsDevice::Kind &kind)
{
    const typename Map::const_iterator found = map.find(element);
    if (found == map.end()) {
        Device *made = static_cast<Device *>(Make(kind_name, section, element, kind));
        map[element] = made;
        return made;
    }
    if (found->second->VsKind() != &kind)
        THROW_ARGOSEXCEPTION("The " << kind_name << " <" << element << "> is asked for as two "
                             "different classes");
    return found->second;
}

}  // namespace

CCI_Sensor *CCI_Controller::VsSensor(const std::string &element, const VsDevice::Kind &kind)
{
    return Find<CCI_Sensor::TMap, CCI_Sensor>(m_mapSensors, "sensor", SENSORS, element, kind);
}

CCI_Actuator *CCI_Controller::VsActuator(const std::string &element, const VsDevice::Kind &kind)
{
    return Find<CCI_Actuator::TMap, CCI_Actuator>(m_mapActuators, "actuator", ACTUATORS, element,
                                                  kind);
}

}  // namespace argos

#ifdef VS_ARGOS_TOGETHER
/* What loop functions then call of it may ask for its devices. */
argos::CCI_Controller *argos::VsControllerOf(const std::string &robot)
{
    const auto found = AllRunning().find(robot);
    if (found == AllRunning().end())
        return nullptr;
    s_robot = found->second.robot;
    s_is_step = false;
    return found->second.state->controller;
}
#endif

extern "C" void vs_argos_log(int is_error, const char *line)
{
#ifdef VS_ARGOS_TOGETHER
    if (argos::VsLoopLogs(is_error != 0, line))
        return;
#endif
    (void)is_error;
    if (argos::s_robot != nullptr)
        vs_robot_log(argos::s_robot, line);
}

extern "C" void vs_argos_fail(const char *words)
{
    vs_robot_fail(argos::s_robot, words);
#if VS_ARGOS_EXCEPTIONS
    std::abort();
#else
    std::longjmp(argos::s_way_out, 1);
#endif
}

const struct vs_controller vs_controller = {
    VS_ARGOS_NAME, sizeof(argos::State), argos::InitState, argos::StepState, argos::EndState,
};
