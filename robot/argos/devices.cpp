/* SPDX-License-Identifier: MIT */
/*
 * devices.cpp - wheels, LEDs, battery and place: see devices.hpp.
 */
#include "devices.hpp"

#include "../layer.h"

namespace argos {

namespace {

const char *Named(const std::string &element, const char *wanted, const char *name)
{
    return element == wanted ? name : nullptr;
}

bool IsLit(const CColor &color)
{
    return (color.GetRed() | color.GetGreen() | color.GetBlue()) != 0;
}

const size_t RING = 8;

/* The robot's own ring counts clockwise. */
unsigned LedBit(size_t led)
{
    return 1u << (RING - led) % RING;
}

/* LEDs that cameras see, where the host has such; the robot's own are always there. */
int VirtualOf(vs_robot *robot, const char *name)
{
    return vs_robot_has_actuator(robot, name) ? vs_robot_actuator(robot, name) : -1;
}

void SetOwn(vs_robot *robot, int led, const CColor &color)
{
    vs_robot_set_rgb(robot, led, color.GetRed(), color.GetGreen(), color.GetBlue());
}

/* With four of them: front right, back right, back left, front left. */
void ShowOwn(vs_robot *robot, const CColor &left, const CColor &right, const CColor &back)
{
    if (vs_robot_rgb_leds(robot) == 4) {
        SetOwn(robot, 0, right);
        SetOwn(robot, 1, back);
        SetOwn(robot, 2, back);
        SetOwn(robot, 3, left);
        return;
    }
    SetOwn(robot, 0, left);
    SetOwn(robot, 1, right);
    SetOwn(robot, 2, back);
}

const CColor &FirstLit(const std::vector<CColor> &colors)
{
    for (const CColor &color : colors)
        if (IsLit(color))
            return color;
    return CColor::BLACK;
}

}  // namespace

const Real CCI_EPuckWheelsActuator::MAX_VELOCITY_CM_SEC = 30.0;
const Real CCI_EPuckWheelsActuator::MIN_VELOCITY_CM_SEC = -30.0;
const Real CCI_EPuckEncoderSensor::WHEEL_AXIS_LENGTH = 0.053f;

const char *CCI_EPuckWheelsActuator::VsNameOf(const std::string &element)
{
    return Named(element, "epuck_wheels", "wheels");
}

const char *CCI_DifferentialSteeringActuator::VsNameOf(const std::string &element)
{
    return Named(element, "differential_steering", "wheels");
}

void VsWheels::VsUpdate(vs_robot *robot)
{
    int steps[2];
    for (int i = 0; i < 2; ++i) {
        const Real wanted = m_fCurrentVelocity[i] * VS_ROBOT_STEPS_PER_CM;
        /* What is no number stops the wheel. */
        steps[i] = wanted == wanted ? static_cast<int>(std::lround(Max(-3e4, Min(wanted, 3e4)))) : 0;
    }
    vs_robot_set_wheels(robot, steps[0], steps[1]);
}

bool VsOdometer::VsBind(vs_robot *robot, const std::string &element, const char *name)
{
    m_axis_cm = vs_robot_param(robot, "vs:axle_cm", m_axis_cm);
    return CCI_Sensor::VsBind(robot, element, name);
}

void VsOdometer::VsUpdate(vs_robot *robot)
{
    Real way_cm[2];
    if (vs_robot_values(robot, m_handle, way_cm, 2) < 2)
        return;
    for (int i = 0; i < 2; ++i) {
        m_covered_cm[i] = m_is_known ? way_cm[i] - m_way_cm[i] : 0.0;
        m_way_cm[i] = way_cm[i];
    }
    m_is_known = true;
}

const char *CCI_EPuckEncoderSensor::VsNameOf(const std::string &element)
{
    return Named(element, "epuck_encoder", "wheels");
}

void CCI_EPuckEncoderSensor::VsUpdate(vs_robot *robot)
{
    VsOdometer::VsUpdate(robot);
    m_sReading = SReading(m_covered_cm[0], m_covered_cm[1]);
}

const char *CCI_DifferentialSteeringSensor::VsNameOf(const std::string &element)
{
    return Named(element, "differential_steering", "wheels");
}

void CCI_DifferentialSteeringSensor::VsUpdate(vs_robot *robot)
{
    const Real step_s = vs_robot_timestep_s(robot);
    VsOdometer::VsUpdate(robot);
    m_sReading = SReading(m_covered_cm[0] / step_s, m_covered_cm[1] / step_s, m_covered_cm[0],
                          m_covered_cm[1], m_axis_cm);
}

const char *CCI_FootBotEncoderSensor::VsNameOf(const std::string &element)
{
    return Named(element, "footbot_encoder", "wheels");
}

void CCI_FootBotEncoderSensor::VsUpdate(vs_robot *robot)
{
    VsOdometer::VsUpdate(robot);
    m_sReading = SReading(m_covered_cm[0], m_covered_cm[1], m_axis_cm);
}

const char *CCI_EPuckBaseLEDsActuator::VsNameOf(const std::string &element)
{
    return Named(element, "epuck_base_leds", "base_leds");
}

bool CCI_EPuckBaseLEDsActuator::VsBind(vs_robot *robot, const std::string &, const char *name)
{
    m_virtual = VirtualOf(robot, name);
    return true;
}

void CCI_EPuckBaseLEDsActuator::SwitchLED(size_t led, bool on)
{
    if (led >= 8)
        return;
    m_unLEDSettings = static_cast<UInt8>(on ? m_unLEDSettings | 1u << led
                                            : m_unLEDSettings & ~(1u << led));
}

void CCI_EPuckBaseLEDsActuator::VsUpdate(vs_robot *robot)
{
    unsigned lit = 0;
    for (size_t i = 0; i < 8; ++i)
        if (m_unLEDSettings >> i & 1)
            lit |= LedBit(i);
    vs_robot_set_leds(robot, lit);
    for (int i = 0; i < 8; ++i)
        vs_robot_actuate(robot, m_virtual, i, m_unLEDSettings >> i & 1 ? 255.0 : 0.0);
}

bool VsLights::VsBind(vs_robot *robot, const std::string &, const char *name)
{
    m_virtual = VirtualOf(robot, name);
    return true;
}

void VsLights::ShowVirtual(vs_robot *robot) const
{
    int number = 0;
    for (const CColor &color : m_tSettings)
        for (const UInt8 level : {color.GetRed(), color.GetGreen(), color.GetBlue()})
            vs_robot_actuate(robot, m_virtual, number++, level);
}

const char *CCI_EPuckRGBLEDsActuator::VsNameOf(const std::string &element)
{
    return Named(element, "epuck_rgb_leds", "rgb_leds");
}

void CCI_EPuckRGBLEDsActuator::VsUpdate(vs_robot *robot)
{
    ShowOwn(robot, m_tSettings[0], m_tSettings[1], m_tSettings[2]);
    ShowVirtual(robot);
}

const char *CCI_LEDsActuator::VsNameOf(const std::string &element)
{
    return Named(element, "leds", "leds");
}

bool CCI_LEDsActuator::VsBind(vs_robot *robot, const std::string &element, const char *name)
{
    m_tSettings.assign(VsCountOf(robot, "vs:lamps", m_tSettings.size()), CColor::BLACK);
    return VsLights::VsBind(robot, element, name);
}

void CCI_LEDsActuator::VsUpdate(vs_robot *robot)
{
    const bool is_epuck = m_tSettings.size() == RING + 3;
    const size_t ring = m_tSettings.size() - (is_epuck ? 3 : 1);
    unsigned lit = 0;
    for (size_t i = 0; i < ring; ++i)
        if (IsLit(m_tSettings[i]))
            lit |= LedBit(i * RING / ring);
    vs_robot_set_leds(robot, lit);
    const CColor *three = &m_tSettings[m_tSettings.size() - 3];
    const CColor &first = FirstLit(m_tSettings);
    if (!is_epuck)
        ShowOwn(robot, first, first, first);
    else if (IsLit(three[0]) || IsLit(three[1]) || IsLit(three[2]))
        ShowOwn(robot, three[0], three[1], three[2]);
    else
        ShowOwn(robot, first, first, first);
    ShowVirtual(robot);
}

bool VsBattery::VsBind(vs_robot *robot, const std::string &element, const char *name)
{
    (void)CCI_Sensor::VsBind(robot, element, name);
    return true;
}

/* Source: the e-puck's own signal that the battery is low comes at 3.4 V; a full one has 4.2 V. */
void VsBattery::VsUpdate(vs_robot *robot)
{
    const struct vs_reading reading = vs_robot_read(robot, m_handle);
    if (reading.known)
        m_fBatteryLevel = Max(0.0, Min(1.0, (reading.value - 3400.0) / 800.0));
}

const char *CCI_EPuckBatterySensor::VsNameOf(const std::string &element)
{
    return Named(element, "epuck_battery", "battery");
}

const char *CCI_BatterySensor::VsNameOf(const std::string &element)
{
    return Named(element, "battery", "battery");
}

const char *CCI_PositioningSensor::VsNameOf(const std::string &element)
{
    return Named(element, "positioning", "gps");
}

void CCI_PositioningSensor::VsUpdate(vs_robot *robot)
{
    Real pose[3];
    if (vs_robot_values(robot, m_handle, pose, 3) < 3)
        return;
    m_sReading.Position.Set(pose[0], pose[1], 0.0);
    m_sReading.Orientation.FromAngleAxis(CRadians(pose[2]), CVector3::Z);
}

}  // namespace argos
