/* SPDX-License-Identifier: MIT */
/*
 * blocks.hpp - arenas whose walls are blocks with LEDs, as IRIDIA's plug-in has them (Source:
 * github.com/demiurge-project/argos3-arena at 480285b): a regular polygon round its middle, wall 1
 * in its direction, the others counter-clockwise; walls and blocks are counted from 1.
 */
#ifndef VS_ARGOS_BLOCKS_HPP
#define VS_ARGOS_BLOCKS_HPP

#include "loop_functions.hpp"

namespace argos {

class CBlockEntity : public VsBox
{
public:
    using VsBox::VsBox;
    std::string GetTypeDescription() const override { return "block"; }
};

class CWallEntity : public CComposableEntity
{
public:
    /* Of blocks of this size, whose x axis leads into the arena; `gap`: between two LEDs of one. */
    CWallEntity(CComposableEntity *arena, const std::string &id, const CVector3 &middle,
                const CQuaternion &orientation, const CVector3 &size, const std::string &medium,
                UInt32 blocks, Real gap = 0.03, Real mass = 1.0);

    std::string GetTypeDescription() const override { return "wall"; }
    CPositionalEntity &GetPositionalEntity() { return m_pose; }
    const std::vector<CBlockEntity *> &GetBlocks() { return m_blocks; }
    std::string VsDescribe() const override;

private:
    CPositionalEntity m_pose;
    std::vector<CBlockEntity *> m_blocks;
};

class CArenaEntity : public CComposableEntity
{
public:
    CArenaEntity(const std::string &id, const CVector3 &position, const CQuaternion &orientation,
                 const CVector3 &size, const std::string &medium, UInt32 blocks, UInt32 edges,
                 Real gap = 0.03, Real mass = 1.0);

    std::string GetTypeDescription() const override { return "arena"; }
    CPositionalEntity &GetPositionalEntity() { return m_pose; }
    const std::vector<CWallEntity *> &GetWalls() { return m_walls; }
    /* A wall that was made for this arena, such as one across it. */
    void AddWall(CWallEntity &wall)
    {
        m_walls.push_back(&wall);
        VsAddPart(wall);
    }
    void SetArenaColor(CColor color);
    void SetWallColor(SInt32 wall, CColor color);
    void SetBoxColor(SInt32 block, SInt32 wall, CColor color);
    Real InnerRadious() { return m_radius; }
    std::string VsDescribe() const override;

private:
    CWallEntity &VsWall(SInt32 wall);

    CPositionalEntity m_pose;
    std::vector<CWallEntity *> m_walls;
    Real m_radius;
};

}  // namespace argos

#endif
