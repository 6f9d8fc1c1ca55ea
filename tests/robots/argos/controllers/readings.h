/* SPDX-License-Identifier: MIT */
/* Every device of an e-puck, a foot-bot and a Pi-Puck in a controller for ARGoS: what it reads goes into a file. */
#ifndef READINGS_H
#define READINGS_H

#include <argos3/core/control_interface/ci_controller.h>
#include <argos3/core/utility/logging/argos_log.h>
#include <argos3/core/utility/math/rng.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_base_leds_actuator.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_battery_sensor.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_encoder_sensor.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_ground_sensor.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_light_sensor.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_omnidirectional_camera_sensor.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_proximity_sensor.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_range_and_bearing_actuator.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_range_and_bearing_sensor.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_rgb_leds_actuator.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_wheels_actuator.h>
#include <argos3/plugins/robots/foot-bot/control_interface/ci_footbot_base_ground_sensor.h>
#include <argos3/plugins/robots/foot-bot/control_interface/ci_footbot_encoder_sensor.h>
#include <argos3/plugins/robots/foot-bot/control_interface/ci_footbot_light_sensor.h>
#include <argos3/plugins/robots/foot-bot/control_interface/ci_footbot_motor_ground_sensor.h>
#include <argos3/plugins/robots/foot-bot/control_interface/ci_footbot_proximity_sensor.h>
#include <argos3/plugins/robots/generic/control_interface/ci_battery_sensor.h>
#include <argos3/plugins/robots/generic/control_interface/ci_colored_blob_omnidirectional_camera_sensor.h>
#include <argos3/plugins/robots/generic/control_interface/ci_destination_virtual_sensor.h>
#include <argos3/plugins/robots/generic/control_interface/ci_differential_steering_actuator.h>
#include <argos3/plugins/robots/generic/control_interface/ci_differential_steering_sensor.h>
#include <argos3/plugins/robots/generic/control_interface/ci_gps_virtual_sensor.h>
#include <argos3/plugins/robots/generic/control_interface/ci_ground_sensor.h>
#include <argos3/plugins/robots/generic/control_interface/ci_leds_actuator.h>
#include <argos3/plugins/robots/generic/control_interface/ci_light_sensor.h>
#include <argos3/plugins/robots/generic/control_interface/ci_positioning_sensor.h>
#include <argos3/plugins/robots/generic/control_interface/ci_proximity_sensor.h>
#include <argos3/plugins/robots/generic/control_interface/ci_range_and_bearing_actuator.h>
#include <argos3/plugins/robots/generic/control_interface/ci_range_and_bearing_sensor.h>
#include <argos3/plugins/robots/generic/control_interface/ci_virtual_black_white_location_sensor.h>
#include <argos3/plugins/robots/generic/control_interface/ci_virtual_pollutant_sensor.h>
#include <argos3/plugins/robots/generic/control_interface/ci_virtual_radiation_sensor.h>
#include <argos3/plugins/robots/generic/control_interface/ci_virtual_rgb_ground_sensor.h>
#include <argos3/plugins/robots/pi-puck/control_interface/ci_pipuck_differential_drive_actuator.h>
#include <argos3/plugins/robots/pi-puck/control_interface/ci_pipuck_differential_drive_sensor.h>
#include <argos3/plugins/robots/pi-puck/control_interface/ci_pipuck_ground_sensor.h>
#include <argos3/plugins/robots/pi-puck/control_interface/ci_pipuck_leds_actuator.h>
#include <argos3/plugins/robots/pi-puck/control_interface/ci_pipuck_rangefinders_sensor.h>

using namespace argos;

/* Asks for the devices that the experiment declares, whichever these are. */
class CReadings : public CCI_Controller
{
public:
    CReadings() : m_pcRNG(CRandom::CreateRNG("argos")) {}
    virtual void Init(TConfigurationNode &t_node);
    virtual void ControlStep();
    virtual void Destroy();

protected:
    template <typename T> T *Sensor(const std::string &name)
    {
        return HasSensor(name) ? GetSensor<T>(name) : NULL;
    }
    template <typename T> T *Actuator(const std::string &name)
    {
        return HasActuator(name) ? GetActuator<T>(name) : NULL;
    }
    void Write(const std::string &name, const std::vector<Real> &values);

private:
    void Sense();
    void SenseAny();
    void SensePiPuck();
    void SenseVirtual();
    void Act();

    std::string m_strFile;
    int m_nFailing;
    int m_nSteps;
    CRandom::CRNG *m_pcRNG;
    char m_chUnset[64]; /* as controllers do that rely on new memory being zeros */
};

#endif
