/* A controller for ARGoS whose header lies in another folder: --sources and --include find both. */
#include <argos3/core/control_interface/ci_controller.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_wheels_actuator.h>

#include "pace.h"

namespace argos {

class CWalk : public CCI_Controller
{
public:
    virtual void Init(TConfigurationNode &)
    {
        m_pcWheels = GetActuator<CCI_EPuckWheelsActuator>("epuck_wheels");
    }

    virtual void ControlStep() { m_pcWheels->SetLinearVelocity(WALK_CM_S, WALK_CM_S); }

private:
    CCI_EPuckWheelsActuator *m_pcWheels;
};

REGISTER_CONTROLLER(CWalk, "walk_controller")

}  // namespace argos
