/* SPDX-License-Identifier: MIT */
/*
 * pipuck.cpp - what a Pi-Puck of ARGoS has: see pipuck.hpp.
 */
#include "pipuck.hpp"

#include "../layer.h"

namespace argos {

namespace {

const unsigned RING = 8;

/* The first half looks one way around an axis in the plane, the other half the other way. Source:
 * ci_pipuck_rangefinders_sensor.cpp, MAP_SENSOR_CONFIG. */
const struct
{
    Real x, y, axis_x, axis_y;
} FINDERS[] = {{0.0333, -0.0096, 0.218, 0.976},  {0.0234, -0.0264, 0.730, 0.683},
               {0.0, -0.0350, 1.0, 0.0},         {-0.0280, -0.0212, 0.630, -0.776},
               {-0.0280, 0.0212, 0.630, 0.776},  {0.0, 0.0350, 1.0, 0.0},
               {0.0234, 0.0264, 0.730, -0.683},  {0.0333, 0.0096, 0.218, -0.976}};
const Real FINDER_HEIGHT_M = 0.0333, FINDER_RANGE_M = 0.1;

const char *Named(const std::string &element, const char *wanted, const char *name)
{
    return element == wanted ? name : nullptr;
}

}  // namespace

const char *CCI_PiPuckDifferentialDriveActuator::VsNameOf(const std::string &element)
{
    return Named(element, "pipuck_differential_drive", "wheels");
}

const char *CCI_PiPuckDifferentialDriveSensor::VsNameOf(const std::string &element)
{
    return Named(element, "pipuck_differential_drive", "wheels");
}

void CCI_PiPuckDifferentialDriveSensor::VsUpdate(vs_robot *robot)
{
    m_step_s = vs_robot_timestep_s(robot);
    VsOdometer::VsUpdate(robot);
}

const char *CCI_PiPuckLEDsActuator::VsNameOf(const std::string &element)
{
    return Named(element, "pipuck_leds", "leds");
}

void CCI_PiPuckLEDsActuator::SetRingLEDIndex(UInt32 led, bool on)
{
    if (led < RING)
        m_ring = on ? m_ring | 1u << led : m_ring & ~(1u << led);
}

void CCI_PiPuckLEDsActuator::VsUpdate(vs_robot *robot)
{
    /* The robot's own ring counts clockwise. */
    unsigned lit = (m_body ? VS_ROBOT_LED_BODY : 0u) | (m_front ? VS_ROBOT_LED_FRONT : 0u);
    for (unsigned i = 0; i < RING; ++i)
        if (m_ring >> i & 1)
            lit |= 1u << (RING - i) % RING;
    vs_robot_set_leds(robot, lit);
}

CCI_PiPuckRangefindersSensor::CCI_PiPuckRangefindersSensor()
{
    for (const auto &finder : FINDERS) {
        const Real turn = m_all.size() < RING / 2 ? 0.5 : -0.5;
        const CQuaternion look(CRadians::PI * turn, CVector3(finder.axis_x, finder.axis_y, 0.0));
        m_all.push_back(VsRangefinder{
            static_cast<UInt8>(m_all.size()),
            VsPlacing("origin", CVector3(finder.x, finder.y, FINDER_HEIGHT_M), look, FINDER_RANGE_M),
            FINDER_RANGE_M, 0.0});
    }
}

const char *CCI_PiPuckRangefindersSensor::VsNameOf(const std::string &element)
{
    return Named(element, "pipuck_rangefinders", "rangefinders");
}

void CCI_PiPuckRangefindersSensor::VsUpdate(vs_robot *robot)
{
    Real values[RING];
    if (vs_robot_values(robot, m_handle, values, RING) >= static_cast<int>(RING))
        for (VsRangefinder &finder : m_all)
            finder.Proximity = values[finder.Label];
}

CCI_PiPuckGroundSensor::CCI_PiPuckGroundSensor()
{
    for (const Real y : {0.01, 0.0, -0.01})
        m_all.push_back(VsGroundInterface{
            static_cast<UInt8>(m_all.size()),
            VsPlacing("origin", CVector3(0.03, y, 0.002), CQuaternion(CRadians::PI, CVector3::Y),
                      0.005),
            0.0, 0.0});
}

const char *CCI_PiPuckGroundSensor::VsNameOf(const std::string &element)
{
    return Named(element, "pipuck_ground", "ground");
}

void CCI_PiPuckGroundSensor::VsUpdate(vs_robot *robot)
{
    Real values[3];
    if (vs_robot_values(robot, m_handle, values, 3) >= 3)
        for (VsGroundInterface &below : m_all)
            below.Reflected = values[below.Label];
}

const char *CCI_PiPuckSystemSensor::VsNameOf(const std::string &element)
{
    return Named(element, "pipuck_system", "clock");
}

void CCI_PiPuckSystemSensor::VsUpdate(vs_robot *robot)
{
    m_fTime += vs_robot_timestep_s(robot);
}

}  // namespace argos
