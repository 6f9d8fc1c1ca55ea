/* SPDX-License-Identifier: MIT */
/* The floor of compare.argos: grey where x and y have the same sign, white elsewhere. */
#include <argos3/core/simulator/loop_functions.h>

using namespace argos;

class CQuarters : public CLoopFunctions
{
public:
    CColor GetFloorColor(const CVector2 &at) override
    {
        return at.GetX() * at.GetY() > 0.0 ? CColor::GRAY40 : CColor::WHITE;
    }
};

REGISTER_LOOP_FUNCTIONS(CQuarters, "floor")
