/* SPDX-License-Identifier: MIT */
/*
 * controller.hpp - ARGoS's controllers, and what all their sensors and actuators have in common.
 * Names and semantics are those of ARGoS 3 (Source: github.com/ilpincy/argos3 at 421bd76,
 * src/core/control_interface); what begins with Vs is ours. controller.cpp makes the daemon's
 * `vs_controller` of the class that REGISTER_CONTROLLER names.
 */
#ifndef VS_ARGOS_CONTROLLER_HPP
#define VS_ARGOS_CONTROLLER_HPP

#include "base.hpp"

struct vs_robot;

namespace argos {

/* What sensors and actuators have in common. */
class VsDevice : public CBaseConfigurableResource
{
public:
    /* What makes a device of one class. The address says which class it is: there is no RTTI. */
    struct Kind
    {
        VsDevice *(*make)();
        /* What the robot calls the device of an XML element, NULL if the class is not for it. */
        const char *(*name_of)(const std::string &element);
    };

    VsDevice() : m_enabled(true), m_kind(nullptr), m_handle(-1) {}
    void Init(TConfigurationNode &) override {}
    void Reset() override {}
    void Destroy() override {}
    virtual void Enable() { m_enabled = true; }
    virtual void Disable() { m_enabled = false; }
    bool IsEnabled() const { return m_enabled; }
    bool IsDisabled() const { return !m_enabled; }

    const Kind *VsKind() const { return m_kind; }
    void VsBecome(const Kind &kind) { m_kind = &kind; }
    /* Binds what the robot calls `name`; false: nobody offers it. `element`: its XML element. */
    virtual bool VsBind(vs_robot *robot, const std::string &element, const char *name) = 0;
    /* In every control step: a sensor reads, before the controller; an actuator acts, after it. */
    virtual void VsUpdate(vs_robot *robot) = 0;

protected:
    bool m_enabled;

private:
    const Kind *m_kind;

protected:
    int m_handle; /* of vs_robot_sensor or vs_robot_actuator */
};

/* A number of things that the host says of a robot that is no e-puck, whose number is `usual`. */
size_t VsCountOf(vs_robot *robot, const char *param, size_t usual);

class CCI_Sensor : public VsDevice
{
public:
    typedef std::map<std::string, CCI_Sensor *, std::less<std::string> > TMap;

    bool VsBind(vs_robot *robot, const std::string &element, const char *name) override;
};

class CCI_Actuator : public VsDevice
{
public:
    typedef std::map<std::string, CCI_Actuator *, std::less<std::string> > TMap;

    /* Every robot has wheels and LEDs: an actuator that needs more says so itself. */
    bool VsBind(vs_robot *, const std::string &, const char *) override { return true; }
};

class CCI_Controller : public CBaseConfigurableResource
{
public:
    CCI_Controller();
    ~CCI_Controller() override;
    CCI_Controller(const CCI_Controller &) = delete;
    CCI_Controller &operator=(const CCI_Controller &) = delete;

    void Init(TConfigurationNode &) override {}
    virtual void ControlStep() {}
    void Reset() override {}
    void Destroy() override {}

    const std::string &GetId() const { return m_strId; }
    void SetId(const std::string &id) { m_strId = id; }

    /* The device of an XML element that the file declares; throws where it does not, where the
     * class is not the element's, and where nobody offers the device to this robot. */
    template <typename T> T *GetSensor(const std::string &element)
    {
        return static_cast<T *>(VsSensor(element, VsKindOf<T>()));
    }
    template <typename T> T *GetActuator(const std::string &element)
    {
        return static_cast<T *>(VsActuator(element, VsKindOf<T>()));
    }

    /* Whether the file declares the device. */
    bool HasSensor(const std::string &element) const;
    bool HasActuator(const std::string &element) const;

    /* Those that were asked for. */
    CCI_Sensor::TMap &GetAllSensors() { return m_mapSensors; }
    CCI_Actuator::TMap &GetAllActuators() { return m_mapActuators; }
    void AddSensor(const std::string &element, CCI_Sensor *sensor) { m_mapSensors[element] = sensor; }
    void AddActuator(const std::string &element, CCI_Actuator *actuator)
    {
        m_mapActuators[element] = actuator;
    }

protected:
    CCI_Actuator::TMap m_mapActuators;
    CCI_Sensor::TMap m_mapSensors;
    std::string m_strId;

private:
    template <typename T> static VsDevice *VsMake() { return new T; }
    template <typename T> static const VsDevice::Kind &VsKindOf()
    {
        static const VsDevice::Kind kind = {&VsMake<T>, &T::VsNameOf};
        return kind;
    }

    CCI_Sensor *VsSensor(const std::string &element, const VsDevice::Kind &kind);
    CCI_Actuator *VsActuator(const std::string &element, const VsDevice::Kind &kind);
};

/* A class that REGISTER_CONTROLLER names; all of a program hang on one chain. */
class VsRegistered
{
public:
    typedef CCI_Controller *(*Maker)(void *memory);

    VsRegistered(const std::string &label, size_t size, Maker make);
    static const VsRegistered *First() { return s_first; }
    const VsRegistered *Next() const { return m_next; }
    const std::string &Label() const { return m_label; }
    size_t Size() const { return m_size; }
    CCI_Controller *Make(void *memory) const { return m_make(memory); }

private:
    static const VsRegistered *s_first;

    std::string m_label;
    size_t m_size;
    Maker m_make;
    const VsRegistered *m_next;
};

template <typename T> CCI_Controller *VsMakeController(void *memory)
{
    return ::new (memory) T;
}

}  // namespace argos

#define VS_ARGOS_JOIN(a, b) a##b
#define VS_ARGOS_VARIABLE(line) VS_ARGOS_JOIN(vs_registered_, line)
#define REGISTER_CONTROLLER(CLASS, LABEL)                             \
    namespace {                                                       \
    const ::argos::VsRegistered VS_ARGOS_VARIABLE(__LINE__)(              \
        LABEL, sizeof(CLASS), &::argos::VsMakeController<CLASS>);     \
    }

#endif
