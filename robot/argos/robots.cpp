/* SPDX-License-Identifier: MIT */
/*
 * robots.cpp - robots of ARGoS's space: see robots.hpp.
 */
#include "robots.hpp"

#include "loop_functions.hpp"

namespace argos {

namespace {

/* Sources: footbot_entity.cpp, dynamics2d_pipuck_model.cpp, kheperaiv_measures.cpp. */
const Real FOOTBOT_RADIUS = 0.085036758f, PIPUCK_RADIUS = 0.0362f, KHEPERA_RADIUS = 0.0704;

template <typename ROBOT> VsRobotEntity *Added(ROBOT *robot)
{
    CSimulator::GetInstance().GetSpace().AddEntity(*robot);
    if (!CSimulator::GetInstance().VsMovesRobots())
        robot->GetEmbodiedEntity().VsStayPut();
    return robot;
}

}  // namespace

const Real CEPuckEntity::BODY_RADIUS = 0.035;
const Real CEPuckEntity::BODY_HEIGHT = 0.086;
const Real CEPuckEntity::INTERWHEEL_DISTANCE = 0.053;
const Real CEPuckEntity::WHEEL_RADIUS = 0.0205;

VsRobotEntity::VsRobotEntity(const std::string &id, const CVector3 &position,
                             const CQuaternion &orientation, Real radius, int leds)
    : CComposableEntity(nullptr, id),
      m_body(this, "body_0", position, orientation, true, VsShape{radius, 0.0, 0.0}),
      m_controllable(this, "controller_0"), m_leds(nullptr)
{
    VsAddPart(m_body);
    VsAddPart(m_controllable);
    for (int i = 0; i < leds; ++i)
        m_leds.AddLED(CVector3());
}

CEntity *VsRobotEntity::VsPart(const std::string &type) const
{
    const bool is_leds = type == m_leds.GetTypeDescription() || type == m_leds.GetId();
    return is_leds ? const_cast<CLEDEquippedEntity *>(&m_leds) : CComposableEntity::VsPart(type);
}

std::string VsRobotEntity::VsDescribe() const
{
    VsWords words;
    words << "robot\t" << GetId();
    VsSayPlace(words, m_body);
    return words.str();
}

CEPuckEntity::CEPuckEntity(const std::string &id, const std::string &, const CVector3 &position,
                           const CQuaternion &orientation, Real, size_t, const std::string &)
    : VsRobotEntity(id, position, orientation, BODY_RADIUS, 8 + 3)
{
}

CFootBotEntity::CFootBotEntity(const std::string &id, const std::string &,
                               const CVector3 &position, const CQuaternion &orientation, Real,
                               size_t, const std::string &)
    : VsRobotEntity(id, position, orientation, FOOTBOT_RADIUS, 12 + 1)
{
}

CKheperaIVEntity::CKheperaIVEntity(const std::string &id)
    : VsRobotEntity(id, CVector3(), CQuaternion(), KHEPERA_RADIUS, 3)
{
}

CPiPuckEntity::CPiPuckEntity(const std::string &id)
    : VsRobotEntity(id, CVector3(), CQuaternion(), PIPUCK_RADIUS, 8 + 2)
{
}

VsRobotEntity *VsAddRobot(const std::string &id, const std::string &model)
{
    if (model == "footbot")
        return Added(new CFootBotEntity(id, ""));
    if (model == "kheperaiv")
        return Added(new CKheperaIVEntity(id));
    if (model == "pipuck")
        return Added(new CPiPuckEntity(id));
    return Added(new CEPuckEntity(id, ""));
}

}  // namespace argos
