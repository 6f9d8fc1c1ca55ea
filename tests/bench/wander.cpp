/* SPDX-License-Identifier: MIT */
/*
 * wander.cpp - wander.c for ARGoS 3 and argos3-epuck: drive ahead, turn away from
 * what the ring sees, a little towards the light.
 */
#include <argos3/core/control_interface/ci_controller.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_light_sensor.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_proximity_sensor.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_wheels_actuator.h>

using namespace argos;

class Wander : public CCI_Controller {
public:
    void Init(TConfigurationNode &) override
    {
        wheels = GetActuator<CCI_EPuckWheelsActuator>("epuck_wheels");
        proximity = GetSensor<CCI_EPuckProximitySensor>("epuck_proximity");
        light = GetSensor<CCI_EPuckLightSensor>("epuck_light");
    }

    void ControlStep() override
    {
        double turn = NEAR * difference(proximity->GetReadings());

        turn -= LIGHT * difference(light->GetReadings());
        wheels->SetLinearVelocity((SPEED_STEPS_S - turn) * STEP_CM,
                                  (SPEED_STEPS_S + turn) * STEP_CM);
    }

private:
    static constexpr double SPEED_STEPS_S = 400.0;
    static constexpr double NEAR = 0.15 * 4095.0; /* readings end at 1 here */
    static constexpr double LIGHT = 20.0;
    static constexpr double STEP_CM = 3.14159265358979 * 4.1 / 1000.0;

    /* What the right half of a ring, here its end, has more than its left half. */
    template <class Readings> static double difference(const Readings &ring)
    {
        return ring[7].Value + ring[6].Value + ring[5].Value - ring[0].Value - ring[1].Value -
               ring[2].Value;
    }

    CCI_EPuckWheelsActuator *wheels = nullptr;
    CCI_EPuckProximitySensor *proximity = nullptr;
    CCI_EPuckLightSensor *light = nullptr;
};

REGISTER_CONTROLLER(Wander, "wander_controller")
