/* SPDX-License-Identifier: MIT */
/* A controller that does without what is not there, and another that throws what it likes. */
#include <cstdlib>

#include <argos3/core/control_interface/ci_controller.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_light_sensor.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_wheels_actuator.h>

namespace argos {

class CCatching : public CCI_Controller
{
public:
    virtual void Init(TConfigurationNode &t_node)
    {
        m_pcWheels = GetActuator<CCI_EPuckWheelsActuator>("epuck_wheels");
        try {
            m_pcLight = GetSensor<CCI_EPuckLightSensor>("epuck_light");
        } catch (CARGoSException &ex) {
            m_pcLight = NULL;
        }
        GetNodeAttributeOrDefault(t_node, "code", m_nCode, 0);
    }

    virtual void ControlStep()
    {
        if (m_nCode != 0)
            throw m_nCode;
        m_pcWheels->SetLinearVelocity(m_pcLight == NULL ? 1.0 : 2.0, 0.0);
    }

private:
    CCI_EPuckWheelsActuator *m_pcWheels;
    CCI_EPuckLightSensor *m_pcLight;
    int m_nCode;
};

REGISTER_CONTROLLER(CCatching, "catching_controller")

}  // namespace argos
