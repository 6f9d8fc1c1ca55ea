/* SPDX-License-Identifier: MIT */
/*
 * pipuck.hpp - what a Pi-Puck of ARGoS has. Names and semantics: github.com/ilpincy/argos3 at 421bd76,
 * src/plugins/robots/pi-puck/control_interface. Speeds are in m/s, distances in m.
 */
#ifndef VS_ARGOS_PIPUCK_HPP
#define VS_ARGOS_PIPUCK_HPP

#include <functional>
#include <tuple>

#include "devices.hpp"

namespace argos {

class CCI_PiPuckDifferentialDriveActuator : public VsWheels
{
public:
    static const char *VsNameOf(const std::string &element);
    void SetLinearVelocity(Real left, Real right) override
    {
        VsWheels::SetLinearVelocity(100.0 * left, 100.0 * right);
    }
};

class CCI_PiPuckDifferentialDriveSensor : public VsOdometer
{
public:
    CCI_PiPuckDifferentialDriveSensor() : m_step_s(1.0) {}
    static const char *VsNameOf(const std::string &element);
    virtual Real GetLeftVelocity() { return 0.01 * m_covered_cm[0] / m_step_s; }
    virtual Real GetRightVelocity() { return 0.01 * m_covered_cm[1] / m_step_s; }
    void VsUpdate(vs_robot *robot) override;

private:
    Real m_step_s;
};

class CCI_PiPuckLEDsActuator : public CCI_Actuator
{
public:
    CCI_PiPuckLEDsActuator() : m_ring(0), m_front(false), m_body(false) {}
    static const char *VsNameOf(const std::string &element);
    virtual void SetRingLEDIndex(UInt32 led, bool on);
    virtual void SetRingLEDs(bool on) { m_ring = on ? 255 : 0; }
    virtual void SetFrontLED(bool on) { m_front = on; }
    virtual void SetBodyLED(bool on) { m_body = on; }
    void VsUpdate(vs_robot *robot) override;

private:
    unsigned m_ring;
    bool m_front, m_body;
};

/* What the sensors of one kind have: their number, where they are, and two values. */
template <typename Interface> class VsInterfaces : public CCI_Sensor
{
public:
    virtual void Visit(std::function<void(const Interface &)> visitor)
    {
        for (const Interface &each : m_all)
            visitor(each);
    }

protected:
    std::vector<Interface> m_all;
};

/* Of a sensor: the anchor, where it is there, how it looks, and how far. */
typedef std::tuple<const char *, CVector3, CQuaternion, Real> VsPlacing;

struct VsRangefinder
{
    UInt8 Label;
    VsPlacing Configuration;
    Real Proximity, Illuminance;
};

class CCI_PiPuckRangefindersSensor : public VsInterfaces<VsRangefinder>
{
public:
    typedef VsPlacing TConfiguration;
    typedef VsRangefinder SInterface;

    CCI_PiPuckRangefindersSensor();
    static const char *VsNameOf(const std::string &element);
    void VsUpdate(vs_robot *robot) override;
};

struct VsGroundInterface
{
    UInt8 Label;
    VsPlacing Configuration;
    Real Reflected, Background;
};

class CCI_PiPuckGroundSensor : public VsInterfaces<VsGroundInterface>
{
public:
    typedef VsPlacing TConfiguration;
    typedef VsGroundInterface SInterface;

    CCI_PiPuckGroundSensor();
    static const char *VsNameOf(const std::string &element);
    void VsUpdate(vs_robot *robot) override;
};

/* The time since the start [s]. */
class CCI_PiPuckSystemSensor : public CCI_Sensor
{
public:
    CCI_PiPuckSystemSensor() : m_fTime(0.0), m_fTemperature(0.0) {}
    static const char *VsNameOf(const std::string &element);
    bool VsBind(vs_robot *, const std::string &, const char *) override { return true; }
    virtual Real GetTime() const { return m_fTime; }
    void VsUpdate(vs_robot *robot) override;

protected:
    Real m_fTime, m_fTemperature;
};

}  // namespace argos

#endif
