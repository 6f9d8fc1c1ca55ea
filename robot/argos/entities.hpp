/* SPDX-License-Identifier: MIT */
/*
 * entities.hpp - what stands in ARGoS's space, as loop functions see and change it. Names and
 * semantics are ARGoS's (Source: src/core/simulator/entity and src/plugins/simulator/entities at
 * 421bd76; the e-puck: github.com/demiurge-project/argos3-epuck at 66cb8d9); what begins with Vs
 * is ours. Every entity mirrors one of the host's world: what changes here is said to the host
 * after each call of the loop functions.
 */
#ifndef VS_ARGOS_ENTITIES_HPP
#define VS_ARGOS_ENTITIES_HPP

#include <functional>
#include <unordered_map>

#include "base.hpp"

namespace argos {

class CComposableEntity;
class CCI_Controller;

class CEntity : public CBaseConfigurableResource
{
public:
    typedef std::vector<CEntity *> TVector;
    typedef std::unordered_map<std::string, CEntity *> TMap;

    CEntity(CComposableEntity *parent, const std::string &id)
        : m_id(id), m_parent(parent), m_enabled(true), m_changed(false)
    {
    }

    void Init(TConfigurationNode &) override {}
    void Reset() override {}
    void Destroy() override {}
    virtual void Update() {}
    virtual std::string GetTypeDescription() const { return "entity"; }

    const std::string &GetId() const { return m_id; }
    std::string GetContext() const;
    bool HasParent() const { return m_parent != nullptr; }
    CComposableEntity &GetParent() { return *m_parent; }
    CEntity &GetRootEntity();
    bool IsEnabled() const { return m_enabled; }
    void SetEnabled(bool enabled) { m_enabled = enabled; }
    void Enable() { SetEnabled(true); }
    void Disable() { SetEnabled(false); }

    /* Whether it has changed since the host was told; a part's change is its whole's. */
    void VsChange();
    bool VsTakeChange();
    /* How the host is told of it, without the word at the front; "": it is not told. */
    virtual std::string VsDescribe() const { return ""; }

private:
    std::string m_id;
    CComposableEntity *m_parent;
    bool m_enabled, m_changed;
};

struct SAnchor
{
    CVector3 Position, OffsetPosition;
    CQuaternion Orientation, OffsetOrientation;
    std::string Id;
};

/* What has a place and no body. */
class CPositionalEntity : public CEntity
{
public:
    CPositionalEntity(CComposableEntity *parent, const std::string &id, const CVector3 &position,
                      const CQuaternion &orientation = CQuaternion())
        : CEntity(parent, id), m_position(position), m_first_position(position),
          m_orientation(orientation), m_first_orientation(orientation)
    {
    }

    void Reset() override { MoveTo(m_first_position, m_first_orientation); }
    const CVector3 &GetPosition() const { return m_position; }
    const CQuaternion &GetOrientation() const { return m_orientation; }
    const CVector3 &GetInitPosition() const { return m_first_position; }
    const CQuaternion &GetInitOrientation() const { return m_first_orientation; }
    void SetInitPosition(const CVector3 &position) { m_first_position = position; }
    void SetInitOrientation(const CQuaternion &turn) { m_first_orientation = turn; }
    void SetPosition(const CVector3 &position) { MoveTo(position, m_orientation); }
    void SetOrientation(const CQuaternion &orientation) { MoveTo(m_position, orientation); }
    std::string GetTypeDescription() const override { return "positional"; }

    virtual void MoveTo(const CVector3 &position, const CQuaternion &orientation)
    {
        m_position = position;
        m_orientation = orientation;
        VsChange();
    }

private:
    CVector3 m_position, m_first_position;
    CQuaternion m_orientation, m_first_orientation;
};

/* A body as it stands on the floor: a disc, or an oblong if it has no radius. */
struct VsShape
{
    Real radius, half_x, half_y;
};

class CEmbodiedEntity : public CEntity
{
public:
    CEmbodiedEntity(CComposableEntity *parent, const std::string &id, const CVector3 &position,
                    const CQuaternion &orientation, bool movable, const VsShape &shape);

    bool IsMovable() const { return m_movable; }
    void SetMovable(bool movable) { m_movable = movable; }
    const SAnchor &GetOriginAnchor() const { return m_origin; }
    SAnchor &GetOriginAnchor() { return m_origin; }
    SAnchor &GetAnchor(const std::string &id);
    std::string GetTypeDescription() const override { return "body"; }

    /* False, and nothing is moved: it would stand in something. */
    virtual bool MoveTo(const CVector3 &position, const CQuaternion &orientation,
                        bool check_only = false, bool ignore_collisions = false);
    virtual bool IsCollidingWithSomething() const;

    CRadians VsYaw() const;
    const VsShape &VsGetShape() const { return m_shape; }
    void VsSetShape(const VsShape &shape) { m_shape = shape; }
    /* Where the host says that it is. */
    void VsPlace(Real x, Real y, Real yaw);
    /* Back to where it was at first. */
    void Reset() override;
    /* Real robots stay where they are; whoever wants to move them is told so by the host. */
    void VsStayPut() { m_stays = true; }

private:
    SAnchor m_origin;
    CVector3 m_first_position;
    CQuaternion m_first_orientation;
    VsShape m_shape;
    bool m_movable, m_stays;
};

/* An entity of parts. Each adds its own; they live as long as it does. */
class CComposableEntity : public CEntity
{
public:
    CComposableEntity(CComposableEntity *parent, const std::string &id) : CEntity(parent, id) {}

    bool HasComponent(const std::string &type) const { return VsPart(type) != nullptr; }

    template <typename T> T &GetComponent(const std::string &type)
    {
        T *part = dynamic_cast<T *>(VsPart(type));
        if (part == nullptr)
            THROW_ARGOSEXCEPTION("\"" << GetId() << "\" has no component \"" << type << "\"");
        return *part;
    }

    const CEntity::TVector &VsParts() const { return m_parts; }
    void Reset() override
    {
        for (CEntity *part : m_parts)
            part->Reset();
        VsChange();
    }

protected:
    void VsAddPart(CEntity &part) { m_parts.push_back(&part); }
    virtual CEntity *VsPart(const std::string &type) const;

private:
    CEntity::TVector m_parts;
};

/* Where controllers and loop functions are compiled together, controller.cpp has the object of a
 * robot's controller, nullptr: it has none; and loop_functions.cpp takes what is logged while a
 * loop function runs, false: none does. */
CCI_Controller *VsControllerOf(const std::string &robot);
bool VsLoopLogs(bool is_error, const char *line);

/* A robot's program. */
class CControllableEntity : public CEntity
{
public:
    typedef std::vector<CControllableEntity *> TVector;

    CControllableEntity(CComposableEntity *parent, const std::string &id) : CEntity(parent, id) {}
    std::string GetTypeDescription() const override { return "controller"; }
    /* Throws where it runs on the robot, or is not compiled together with the loop functions. */
    CCI_Controller &GetController();
};

class CLEDEntity : public CPositionalEntity
{
public:
    typedef std::vector<CLEDEntity *> TList;

    CLEDEntity(CComposableEntity *parent, const std::string &id, const CVector3 &position,
               const CColor &color)
        : CPositionalEntity(parent, id, position), m_color(color), m_first_color(color)
    {
    }

    void Reset() override
    {
        CPositionalEntity::Reset();
        SetColor(m_first_color);
    }
    const CColor &GetColor() const { return m_color; }
    const CColor &GetInitColor() const { return m_first_color; }
    void SetInitColor(const CColor &color) { m_first_color = color; }
    std::string GetTypeDescription() const override { return "led"; }
    void SetColor(const CColor &color)
    {
        if (color != m_color)
            VsChange();
        m_color = color;
    }

private:
    CColor m_color, m_first_color;
};

class CLightEntity : public CLEDEntity
{
public:
    CLightEntity(const std::string &id, const CVector3 &position, const CColor &color,
                 Real intensity)
        : CLEDEntity(nullptr, id, position, color), m_intensity(intensity)
    {
    }

    Real GetIntensity() const { return m_intensity; }
    void SetIntensity(Real intensity)
    {
        m_intensity = intensity;
        VsChange();
    }
    std::string GetTypeDescription() const override { return "light"; }
    std::string VsDescribe() const override;

private:
    Real m_intensity;
};

/* Where LEDs are asked for in ARGoS; here every camera sees every LED. */
class CLEDMedium
{
};

/* The LEDs of something; each is a part of it, with its place in the frame of its base. */
class CLEDEquippedEntity : public CEntity
{
public:
    struct SActuator
    {
        typedef std::vector<SActuator *> TList;

        CLEDEntity &LED;
        CVector3 Offset;
    };

    explicit CLEDEquippedEntity(CComposableEntity *parent) : CEntity(parent, "leds_0") {}

    void Reset() override;
    std::string GetTypeDescription() const override { return "leds"; }
    void AddLED(const CVector3 &offset, const CColor &color = CColor::BLACK);
    void AddLED(const CVector3 &offset, SAnchor &, const CColor &color = CColor::BLACK)
    {
        AddLED(offset, color);
    }
    SActuator::TList &GetLEDs() { return m_leds; }
    CLEDEntity &GetLED(UInt32 number);
    void SetLEDColor(UInt32 number, const CColor &color) { GetLED(number).SetColor(color); }
    void SetAllLEDsColors(const CColor &color);
    void SetAllLEDsColors(const std::vector<CColor> &colors);
    void SetMedium(CLEDMedium &) {}
    /* Of each LED its place and its colour, six numbers. */
    std::vector<Real> VsNumbers() const;

private:
    SActuator::TList m_leds;
};

/* What stands: a body, and perhaps LEDs on it. */
class VsObstacle : public CComposableEntity
{
public:
    VsObstacle(CComposableEntity *parent, const std::string &id, const CVector3 &position,
               const CQuaternion &orientation, bool movable, const VsShape &shape, Real mass)
        : CComposableEntity(parent, id), m_mass(mass),
          m_body(this, "body_0", position, orientation, movable, shape), m_leds(this)
    {
        VsAddPart(m_body);
        VsAddPart(m_leds);
    }

    CEmbodiedEntity &GetEmbodiedEntity() { return m_body; }
    CLEDEquippedEntity &GetLEDEquippedEntity() { return m_leds; }
    const CLEDEquippedEntity &GetLEDEquippedEntity() const { return m_leds; }
    void EnableLEDs(CLEDMedium &) {}
    void DisableLEDs() { m_leds.SetAllLEDsColors(CColor::BLACK); }
    void AddLED(const CVector3 &offset, const CColor &color = CColor::BLACK)
    {
        m_leds.AddLED(offset, color);
    }
    const CEmbodiedEntity &GetEmbodiedEntity() const { return m_body; }
    Real GetMass() const { return m_mass; }
    void SetMass(Real mass) { m_mass = mass; }

private:
    Real m_mass;
    CEmbodiedEntity m_body;
    CLEDEquippedEntity m_leds;
};

class VsBox : public VsObstacle
{
public:
    VsBox(CComposableEntity *parent, const std::string &id, const CVector3 &position,
          const CQuaternion &orientation, bool movable, const CVector3 &size, Real mass);

    const CVector3 &GetSize() const { return m_size; }
    void Resize(const CVector3 &size);
    void SetSize(const CVector3 &size) { Resize(size); }
    std::string VsDescribe() const override;

private:
    CVector3 m_size;
};

class CBoxEntity : public VsBox
{
public:
    CBoxEntity(const std::string &id, const CVector3 &position, const CQuaternion &orientation,
               bool movable, const CVector3 &size, Real mass = 1.0)
        : VsBox(nullptr, id, position, orientation, movable, size, mass)
    {
    }

    std::string GetTypeDescription() const override { return "box"; }
};

class CCylinderEntity : public VsObstacle
{
public:
    CCylinderEntity(const std::string &id, const CVector3 &position,
                    const CQuaternion &orientation, bool movable, Real radius, Real height,
                    Real mass = 1.0);

    Real GetRadius() const { return m_radius; }
    Real GetHeight() const { return m_height; }
    void Resize(Real radius, Real height);
    std::string GetTypeDescription() const override { return "cylinder"; }
    std::string VsDescribe() const override;

private:
    Real m_radius, m_height;
};

/* Says where a body stands, its base: x, y, z and yaw. */
void VsSayPlace(VsWords &words, const CEmbodiedEntity &body);

class CFloorEntity : public CEntity
{
public:
    CFloorEntity() : CEntity(nullptr, "floor") {}

    std::string GetTypeDescription() const override { return "floor"; }
    bool HasChanged() const { return m_changed_colors; }
    void SetChanged() { m_changed_colors = true; }
    void ClearChanged() { m_changed_colors = false; }
    CColor GetColorAtPoint(Real x, Real y);

private:
    bool m_changed_colors = false;
};

}  // namespace argos

#endif
