/* SPDX-License-Identifier: MIT */
/*
 * entities.cpp - what stands in ARGoS's space: see entities.hpp.
 */
#include "blocks.hpp"
#include "loop_functions.hpp"

namespace argos {

std::string CEntity::GetContext() const
{
    return m_parent == nullptr ? "" : m_parent->GetContext() + m_parent->GetId() + ".";
}

CEntity &CEntity::GetRootEntity()
{
    return m_parent == nullptr ? *this : m_parent->GetRootEntity();
}

void CEntity::VsChange()
{
    GetRootEntity().m_changed = true;
}

bool CEntity::VsTakeChange()
{
    const bool changed = m_changed;
    m_changed = false;
    return changed;
}

/* ------------------------------------------------------------------ bodies */

CEmbodiedEntity::CEmbodiedEntity(CComposableEntity *parent, const std::string &id,
                                 const CVector3 &position, const CQuaternion &orientation,
                                 bool movable, const VsShape &shape)
    : CEntity(parent, id), m_first_position(position), m_first_orientation(orientation),
      m_shape(shape), m_movable(movable), m_stays(false)
{
    m_origin.Position = position;
    m_origin.Orientation = orientation;
    m_origin.Id = "origin";
}

SAnchor &CEmbodiedEntity::GetAnchor(const std::string &id)
{
    if (id != m_origin.Id)
        THROW_ARGOSEXCEPTION("\"" << GetRootEntity().GetId() << "\" has no anchor \"" << id
                                  << "\": there is \"origin\" alone");
    return m_origin;
}

CRadians CEmbodiedEntity::VsYaw() const
{
    CRadians z, y, x;
    m_origin.Orientation.ToEulerAngles(z, y, x);
    return z;
}

bool CEmbodiedEntity::MoveTo(const CVector3 &position, const CQuaternion &orientation,
                             bool check_only, bool ignore_collisions)
{
    CRadians z, y, x;
    orientation.ToEulerAngles(z, y, x);
    const CSpace &space = CSimulator::GetInstance().GetSpace();
    if (!ignore_collisions && !space.VsIsFree(*this, position, z.GetValue()))
        return false;
    if (check_only)
        return true;
    if (!m_stays) {
        m_origin.Position = position;
        m_origin.Orientation = orientation;
    }
    VsChange();
    return true;
}

bool CEmbodiedEntity::IsCollidingWithSomething() const
{
    const CSpace &space = CSimulator::GetInstance().GetSpace();
    return !space.VsIsFree(*this, m_origin.Position, VsYaw().GetValue());
}

void CEmbodiedEntity::VsPlace(Real x, Real y, Real yaw)
{
    m_origin.Position.Set(x, y, m_origin.Position.GetZ());
    m_origin.Orientation = CQuaternion(CRadians(yaw), CVector3::Z);
}

void CEmbodiedEntity::Reset()
{
    m_origin.Position = m_first_position;
    m_origin.Orientation = m_first_orientation;
}

CEntity *CComposableEntity::VsPart(const std::string &type) const
{
    for (CEntity *part : m_parts)
        if (part->GetTypeDescription() == type || part->GetId() == type)
            return part;
    return nullptr;
}

CCI_Controller &CControllableEntity::GetController()
{
#ifdef VS_ARGOS_TOGETHER
    if (CCI_Controller *found = VsControllerOf(GetRootEntity().GetId()))
        return *found;
#endif
    THROW_ARGOSEXCEPTION("GetController() of \"" << GetContext() << "\": it runs apart from loop"
                         " functions; have it show what is wanted of it with its LEDs");
}

/* ------------------------------------------------------------------ LEDs */

void CLEDEquippedEntity::AddLED(const CVector3 &offset, const CColor &color)
{
    const std::string id = "led_" + ToString(m_leds.size());
    CLEDEntity *led = new CLEDEntity(HasParent() ? &GetParent() : nullptr, id, offset, color);
    m_leds.push_back(new SActuator{*led, offset});
    VsChange();
}

CLEDEntity &CLEDEquippedEntity::GetLED(UInt32 number)
{
    if (number >= m_leds.size())
        THROW_ARGOSEXCEPTION("\"" << GetRootEntity().GetId() << "\" has " << m_leds.size()
                                  << " LEDs, there is none with number " << number);
    return m_leds[number]->LED;
}

void CLEDEquippedEntity::SetAllLEDsColors(const CColor &color)
{
    for (SActuator *each : m_leds)
        each->LED.SetColor(color);
}

void CLEDEquippedEntity::SetAllLEDsColors(const std::vector<CColor> &colors)
{
    for (size_t i = 0; i < colors.size(); ++i)
        SetLEDColor(static_cast<UInt32>(i), colors[i]);
}

void CLEDEquippedEntity::Reset()
{
    for (SActuator *each : m_leds)
        each->LED.SetColor(each->LED.GetInitColor());
}

std::vector<Real> CLEDEquippedEntity::VsNumbers() const
{
    std::vector<Real> numbers;
    for (const SActuator *each : m_leds) {
        const CColor &color = each->LED.GetColor();
        const Real six[] = {each->Offset.GetX(),  each->Offset.GetY(),   each->Offset.GetZ(),
                            Real(color.GetRed()), Real(color.GetGreen()), Real(color.GetBlue())};
        numbers.insert(numbers.end(), six, six + 6);
    }
    return numbers;
}

/* ------------------------------------------------------------------ what the host is told */

void VsSayPlace(VsWords &words, const CEmbodiedEntity &body)
{
    const CVector3 &at = body.GetOriginAnchor().Position;
    const Real numbers[] = {at.GetX(), at.GetY(), at.GetZ(), body.VsYaw().GetValue()};
    char text[40];
    for (const Real number : numbers) {
        std::snprintf(text, sizeof text, "\t%.17g", number);
        words << text;
    }
}

namespace {

void Numbers(VsWords &words, const std::vector<Real> &numbers)
{
    char text[40];
    for (const Real number : numbers) {
        std::snprintf(text, sizeof text, "\t%.17g", number);
        words << text;
    }
}

/* As many lines as the parts have that the host knows. */
std::string Lines(const CEntity::TVector &parts)
{
    std::string lines;
    for (const CEntity *part : parts) {
        const std::string line = part->VsDescribe();
        lines += (lines.empty() || line.empty() ? "" : "\n") + line;
    }
    return lines;
}

VsShape Oblong(const CVector3 &size)
{
    return VsShape{0.0, size.GetX() / 2.0, size.GetY() / 2.0};
}

}  // namespace

std::string CLightEntity::VsDescribe() const
{
    VsWords words;
    const CVector3 &at = GetPosition();
    const CColor &color = GetColor();
    words << "light\t" << GetId();
    Numbers(words, {at.GetX(), at.GetY(), at.GetZ(), m_intensity, Real(color.GetRed()),
                    Real(color.GetGreen()), Real(color.GetBlue())});
    return words.str();
}

VsBox::VsBox(CComposableEntity *parent, const std::string &id, const CVector3 &position,
             const CQuaternion &orientation, bool movable, const CVector3 &size, Real mass)
    : VsObstacle(parent, id, position, orientation, movable, Oblong(size), mass), m_size(size)
{
}

void VsBox::Resize(const CVector3 &size)
{
    m_size = size;
    GetEmbodiedEntity().VsSetShape(Oblong(size));
    VsChange();
}

std::string VsBox::VsDescribe() const
{
    VsWords words;
    words << "box\t" << GetId();
    VsSayPlace(words, GetEmbodiedEntity());
    Numbers(words, {m_size.GetX(), m_size.GetY(), m_size.GetZ()});
    Numbers(words, GetLEDEquippedEntity().VsNumbers());
    return words.str();
}

CCylinderEntity::CCylinderEntity(const std::string &id, const CVector3 &position,
                                 const CQuaternion &orientation, bool movable, Real radius,
                                 Real height, Real mass)
    : VsObstacle(nullptr, id, position, orientation, movable, VsShape{radius, 0.0, 0.0}, mass),
      m_radius(radius), m_height(height)
{
}

void CCylinderEntity::Resize(Real radius, Real height)
{
    m_radius = radius;
    m_height = height;
    GetEmbodiedEntity().VsSetShape(VsShape{radius, 0.0, 0.0});
    VsChange();
}

std::string CCylinderEntity::VsDescribe() const
{
    VsWords words;
    words << "cylinder\t" << GetId();
    VsSayPlace(words, GetEmbodiedEntity());
    Numbers(words, {m_radius, m_height});
    Numbers(words, GetLEDEquippedEntity().VsNumbers());
    return words.str();
}

/* ------------------------------------------------------------------ arenas of blocks */

CWallEntity::CWallEntity(CComposableEntity *arena, const std::string &id, const CVector3 &middle,
                         const CQuaternion &turn, const CVector3 &size, const std::string &,
                         UInt32 blocks, Real gap, Real)
    : CComposableEntity(arena, id), m_pose(this, "pose_0", middle, turn)
{
    CRadians yaw, y, x;
    turn.ToEulerAngles(yaw, y, x);
    const Real first = (blocks * size.GetY() - size.GetY()) / 2.0;
    const UInt32 leds = static_cast<UInt32>(std::ceil(size.GetY() / gap));
    for (UInt32 i = 0; i < blocks; ++i) {
        const Real along = first - i * size.GetY();
        CBlockEntity *block = new CBlockEntity(
            this, id + ".block_" + ToString(i + 1),
            middle + CVector3(-along * Sin(yaw), along * Cos(yaw), 0.0), turn, false, size, 1.0);
        for (UInt32 led = 0; led < leds; ++led)
            block->AddLED(CVector3(0.0075, (gap - size.GetY()) / 2.0 + led * gap, 0.067));
        m_blocks.push_back(block);
        VsAddPart(*block);
    }
}

std::string CWallEntity::VsDescribe() const
{
    return Lines(VsParts());
}

CArenaEntity::CArenaEntity(const std::string &id, const CVector3 &position,
                           const CQuaternion &orientation, const CVector3 &size,
                           const std::string &medium, UInt32 blocks, UInt32 edges, Real gap, Real)
    : CComposableEntity(nullptr, id), m_pose(this, "pose_0", position, orientation)
{
    const CRadians each = CRadians::TWO_PI / static_cast<Real>(edges);
    CRadians z, y, x;
    orientation.ToEulerAngles(z, y, x);
    m_radius = size.GetY() * blocks / (2.0 * Tan(each / 2.0));
    for (UInt32 i = 0; i < edges; ++i) {
        const CRadians angle = z + each * static_cast<Real>(i);
        const CVector3 middle(m_radius * Cos(angle), m_radius * Sin(angle), 0.0);
        AddWall(*new CWallEntity(this, id + ".wall_" + ToString(i), position + middle,
                                 CQuaternion(angle - CRadians::PI, CVector3::Z), size, medium,
                                 blocks, gap));
    }
}

void CArenaEntity::SetArenaColor(CColor color)
{
    for (size_t i = 1; i <= m_walls.size(); ++i)
        SetWallColor(static_cast<SInt32>(i), color);
}

void CArenaEntity::SetWallColor(SInt32 wall, CColor color)
{
    for (size_t i = 1; i <= VsWall(wall).GetBlocks().size(); ++i)
        SetBoxColor(static_cast<SInt32>(i), wall, color);
}

void CArenaEntity::SetBoxColor(SInt32 block, SInt32 wall, CColor color)
{
    const std::vector<CBlockEntity *> &blocks = VsWall(wall).GetBlocks();
    if (block < 1 || static_cast<size_t>(block) > blocks.size())
        THROW_ARGOSEXCEPTION("wall " << wall << " of \"" << GetId() << "\" has no block " << block);
    blocks[static_cast<size_t>(block) - 1]->GetLEDEquippedEntity().SetAllLEDsColors(color);
}

CWallEntity &CArenaEntity::VsWall(SInt32 wall)
{
    if (wall < 1 || static_cast<size_t>(wall) > m_walls.size())
        THROW_ARGOSEXCEPTION("\"" << GetId() << "\" has no wall " << wall);
    return *m_walls[static_cast<size_t>(wall) - 1];
}

std::string CArenaEntity::VsDescribe() const
{
    return Lines(VsParts());
}

CColor CFloorEntity::GetColorAtPoint(Real x, Real y)
{
    return CSimulator::GetInstance().GetLoopFunctions().GetFloorColor(CVector2(x, y));
}

/* ------------------------------------------------------------------ the space */

CEntity &CSpace::GetEntity(const std::string &id)
{
    const CEntity::TMap::const_iterator found = m_by_id.find(id);
    if (found == m_by_id.end())
        THROW_ARGOSEXCEPTION("Unknown entity id \"" << id
                             << "\" when requesting entity from space.");
    return *found->second;
}

void CSpace::GetEntitiesMatching(CEntity::TVector &found, const std::string &pattern)
{
    for (CEntity *entity : m_entities)
        if (MatchPattern(entity->GetContext() + entity->GetId(), pattern))
            found.push_back(entity);
}

/* IRIDIA's e-puck is an "epuck", ARGoS's own an "e-puck": both find ours. */
CSpace::TMapPerType &CSpace::GetEntitiesByType(const std::string &type)
{
    const TMapPerTypePerId::iterator found = m_by_type.find(type == "e-puck" ? "epuck" : type);
    if (found == m_by_type.end())
        THROW_ARGOSEXCEPTION("Entity map for type \"" << type << "\" not found.");
    return found->second;
}

void CSpace::IterateOverControllableEntities(const TControllableEntityIterCBType &call)
{
    for (auto &each : m_by_type["controller"])
        call(any_cast<CControllableEntity *>(each.second));
}

void CSpace::VsSetArena(const CVector3 &size, const CVector3 &center)
{
    m_size = size;
    m_center = center;
    m_limits.Set(center - size / 2.0, center + size / 2.0);
    VsIndexAs(m_floor.GetTypeDescription(), m_floor.GetId(), CAny(&m_floor));
}

void CSpace::VsIndexAs(const std::string &type, const std::string &id, const CAny &entity)
{
    m_by_type[type][id] = entity;
}

void CSpace::VsIndex(CEntity &entity)
{
    const std::string id = entity.GetContext() + entity.GetId();
    if (m_by_id.count(id) > 0)
        THROW_ARGOSEXCEPTION("Error inserting a " << entity.GetTypeDescription()
                             << " entity with id \"" << id
                             << "\". An entity with that id already exists.");
    m_by_id[id] = &entity;
    m_entities.push_back(&entity);
    if (!entity.HasParent())
        m_roots.push_back(&entity);
    if (CEmbodiedEntity *body = dynamic_cast<CEmbodiedEntity *>(&entity)) {
        m_bodies.push_back(body);
        VsIndexAs("body", id, CAny(body));
    }
    if (CControllableEntity *controllable = dynamic_cast<CControllableEntity *>(&entity))
        VsIndexAs("controller", id, CAny(controllable));
    if (CBlockEntity *block = dynamic_cast<CBlockEntity *>(&entity))
        VsIndexAs("block", id, CAny(block));
    if (CWallEntity *wall = dynamic_cast<CWallEntity *>(&entity))
        VsIndexAs("wall", id, CAny(wall));
    if (CComposableEntity *whole = dynamic_cast<CComposableEntity *>(&entity))
        for (CEntity *part : whole->VsParts())
            VsIndex(*part);
}

void CSpace::VsRemove(CEntity &entity)
{
    CEntity::TVector gone(1, &entity);
    for (size_t i = 0; i < gone.size(); ++i)
        if (CComposableEntity *whole = dynamic_cast<CComposableEntity *>(gone[i]))
            gone.insert(gone.end(), whole->VsParts().begin(), whole->VsParts().end());
    for (CEntity *part : gone) {
        const std::string id = part->GetContext() + part->GetId();
        m_by_id.erase(id);
        for (auto &type : m_by_type)
            type.second.erase(id);
        m_entities.erase(std::remove(m_entities.begin(), m_entities.end(), part),
                         m_entities.end());
        m_roots.erase(std::remove(m_roots.begin(), m_roots.end(), part), m_roots.end());
        m_bodies.erase(std::remove(m_bodies.begin(), m_bodies.end(), part), m_bodies.end());
    }
    entity.Destroy();
    delete &entity;
}

namespace {

/* A body's outline in the frame of another one that is an oblong, or round. */
bool Touch(const CVector2 &between, const VsShape &round, Real yaw, const VsShape &other)
{
    if (other.radius > 0.0)
        return between.Length() < round.radius + other.radius;
    const CVector2 seen = CVector2(between).Rotate(CRadians(-yaw)).Absolute();
    const CVector2 beyond(Max<Real>(seen.GetX() - other.half_x, 0.0),
                          Max<Real>(seen.GetY() - other.half_y, 0.0));
    return beyond.Length() < round.radius;
}

}  // namespace

/* Two oblongs do not hinder each other: neither of them drives. */
bool CSpace::VsIsFree(const CEmbodiedEntity &body, const CVector3 &at, Real yaw) const
{
    const VsShape &shape = body.VsGetShape();
    for (const CEmbodiedEntity *other : m_bodies) {
        const CVector3 apart = at - other->GetOriginAnchor().Position;
        const CVector2 flat(apart.GetX(), apart.GetY());
        const VsShape &others = other->VsGetShape();
        if (other == &body)
            continue;
        if (shape.radius > 0.0 && Touch(flat, shape, other->VsYaw().GetValue(), others))
            return false;
        if (shape.radius == 0.0 && others.radius > 0.0 && Touch(-flat, others, yaw, shape))
            return false;
    }
    return true;
}

}  // namespace argos
