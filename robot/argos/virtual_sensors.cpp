/* SPDX-License-Identifier: MIT */
/*
 * virtual_sensors.cpp - the virtual sensors of IRIDIA's system: see virtual_sensors.hpp.
 */
#include "virtual_sensors.hpp"

#include "../controller.h"

namespace argos {

namespace {

const char *Named(const std::string &element, const char *wanted, const char *name)
{
    return element == wanted ? name : nullptr;
}

}  // namespace

void VsPoseSensor::VsUpdate(vs_robot *robot)
{
    Real pose[3];
    const struct vs_reading reading = vs_robot_read(robot, m_handle);
    if (vs_robot_values(robot, m_handle, pose, 3) < 3)
        return;
    m_cReading = CVirtualSensorDataPosition2D(pose[0], pose[1], pose[2]);
    m_unTimeTillUpdate = static_cast<UInt32>(static_cast<Real>(reading.age_ns) * 1e-9 /
                                             vs_robot_timestep_s(robot));
}

const char *CCI_GPSVirtualSensor::VsNameOf(const std::string &element)
{
    return Named(element, "gps_virtual_sensor", "gps");
}

const char *CCI_DestinationVirtualSensor::VsNameOf(const std::string &element)
{
    return Named(element, "destination_virtual_sensor", "destination");
}

const char *CCI_VirtualRGBGroundSensor::VsNameOf(const std::string &element)
{
    return Named(element, "virtual_rgb_ground_sensor", "rgb_ground");
}

void CCI_VirtualRGBGroundSensor::VsUpdate(vs_robot *robot)
{
    Real color[3];
    if (vs_robot_values(robot, m_handle, color, 3) < 3)
        return;
    m_cReading.R = static_cast<UInt8>(color[0]);
    m_cReading.G = static_cast<UInt8>(color[1]);
    m_cReading.B = static_cast<UInt8>(color[2]);
}

const char *CCI_VirtualRadiationSensor::VsNameOf(const std::string &element)
{
    return Named(element, "virtual_radiation_sensor", "radiation");
}

void CCI_VirtualRadiationSensor::VsUpdate(vs_robot *robot)
{
    m_cReading.Intensity = vs_robot_read(robot, m_handle).value;
}

const char *CCI_VirtualPollutantSensor::VsNameOf(const std::string &element)
{
    return Named(element, "virtual_pollutant_sensor", "pollutant");
}

void CCI_VirtualPollutantSensor::VsUpdate(vs_robot *robot)
{
    m_cReading.Value = vs_robot_read(robot, m_handle).value;
}

const char *CCI_VirtualBlackWhiteLocationSensor::VsNameOf(const std::string &element)
{
    return Named(element, "virtual_black_white_location_sensor", "black_white_location");
}

void CCI_VirtualBlackWhiteLocationSensor::VsUpdate(vs_robot *robot)
{
    Real towards[4];
    if (vs_robot_values(robot, m_handle, towards, 4) < 4)
        return;
    m_cReading.vBlackLocation.Set(towards[0], towards[1]);
    m_cReading.vWhiteLocation.Set(towards[2], towards[3]);
}

}  // namespace argos
