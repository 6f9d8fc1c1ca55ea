/* SPDX-License-Identifier: MIT */
/*
 * robots.hpp - robots of ARGoS's space, as loop functions find them. They belong to their programs:
 * what their LEDs show the host says, and to set them changes nothing.
 */
#ifndef VS_ARGOS_ROBOTS_HPP
#define VS_ARGOS_ROBOTS_HPP

#include "entities.hpp"

namespace argos {

class VsRobotEntity : public CComposableEntity
{
public:
    CEmbodiedEntity &GetEmbodiedEntity() { return m_body; }
    CControllableEntity &GetControllableEntity() { return m_controllable; }
    CLEDEquippedEntity &GetLEDEquippedEntity() { return m_leds; }
    std::string VsDescribe() const override;

protected:
    VsRobotEntity(const std::string &id, const CVector3 &position, const CQuaternion &orientation,
                  Real radius, int leds);
    CEntity *VsPart(const std::string &type) const override;

private:
    CEmbodiedEntity m_body;
    CControllableEntity m_controllable;
    CLEDEquippedEntity m_leds; /* no part of it: a colour is no change of the robot */
};

/* Its LEDs: the ring of 8, counter-clockwise from the front left, and the three in colour. */
class CEPuckEntity : public VsRobotEntity
{
public:
    static const Real BODY_RADIUS, BODY_HEIGHT, INTERWHEEL_DISTANCE, WHEEL_RADIUS;

    CEPuckEntity(const std::string &id, const std::string &controller,
                 const CVector3 &position = CVector3(),
                 const CQuaternion &orientation = CQuaternion(), Real rab_range = 0.8,
                 size_t rab_data_size = 2, const std::string &battery = "");

    std::string GetTypeDescription() const override { return "epuck"; }
};

/* Its LEDs: the ring of 12, likewise, and the beacon. */
class CFootBotEntity : public VsRobotEntity
{
public:
    CFootBotEntity(const std::string &id, const std::string &controller,
                   const CVector3 &position = CVector3(),
                   const CQuaternion &orientation = CQuaternion(), Real rab_range = 3.0,
                   size_t rab_data_size = 10, const std::string &battery = "");

    std::string GetTypeDescription() const override { return "foot-bot"; }
};

class CKheperaIVEntity : public VsRobotEntity
{
public:
    explicit CKheperaIVEntity(const std::string &id);

    std::string GetTypeDescription() const override { return "kheperaiv"; }
};

class CPiPuckEntity : public VsRobotEntity
{
public:
    explicit CPiPuckEntity(const std::string &id);

    std::string GetTypeDescription() const override { return "pipuck"; }
};

/* A robot of a model, which the space lists as ARGoS does. */
VsRobotEntity *VsAddRobot(const std::string &id, const std::string &model);

}  // namespace argos

#endif
