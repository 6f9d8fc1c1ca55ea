/* SPDX-License-Identifier: MIT */
/* mission.cpp - loop functions as missions for ARGoS have them, in one class that does everything. */
#include <argos3/core/simulator/loop_functions.h>
#include <argos3/core/simulator/space/space.h>
#include <argos3/plugins/robots/arena/simulator/arena_entity.h>
#include <argos3/plugins/robots/e-puck/simulator/epuck_entity.h>
#include <argos3/plugins/simulator/entities/box_entity.h>
#include <argos3/plugins/simulator/entities/cylinder_entity.h>
#include <argos3/plugins/simulator/entities/light_entity.h>

#include <csignal>
#include <unistd.h>

using namespace argos;

class CMission : public CLoopFunctions {
public:
   CMission() : m_fScore(0.0), m_fEdge(0.0), m_unEnd(0), m_unFailsFrom(0) {}

   virtual void Init(TConfigurationNode& t_tree) {
      m_pcRng = CRandom::CreateRNG("argos");
      TConfigurationNode& tParams = GetNode(t_tree, "params");
      GetNodeAttributeOrDefault(tParams, "edge", m_fEdge, (Real) 0.0);
      GetNodeAttributeOrDefault(tParams, "end", m_unEnd, (UInt32) 0);
      GetNodeAttributeOrDefault(tParams, "fails_in", m_strFailsIn, std::string(""));
      GetNodeAttributeOrDefault(tParams, "fails_from", m_unFailsFrom, (UInt32) 0);
      GetNodeAttributeOrDefault(tParams, "how", m_strHow, std::string(""));
      GetNodeAttributeOrDefault(tParams, "move", m_bMove, true);
      GetNodeAttributeOrDefault(tParams, "restless", m_bRestless, false);
      CSpace::TMapPerType& tFloors = GetSpace().GetEntitiesByType("floor");
      CEPuckEntity& cFirst = *any_cast<CEPuckEntity*>(GetSpace().GetEntitiesByType("epuck").begin()->second);
      LOG << "from " << GetSpace().GetArenaLimits().GetMin() << " to " << GetSpace().GetArenaLimits().GetMax()
          << " " << tFloors.size() << " floor "
          << cFirst.GetComponent<CLEDEquippedEntity>("leds").GetLEDs().size() << " LEDs" << std::endl;
      LOG << "arena " << GetSpace().GetArenaSize() << " seed " << CSimulator::GetInstance().GetRandomSeed()
          << " length " << CSimulator::GetInstance().GetMaxSimulationClock() << " tick "
          << CPhysicsEngine::GetSimulationClockTick() << std::endl;
      if(m_bMove) {
         m_pcBox = new CBoxEntity("added", CVector3(0.3, 0.5, 0.0),
                                  CQuaternion().FromEulerAngles(CRadians::PI_OVER_FOUR, CRadians::ZERO, CRadians::ZERO),
                                  false, CVector3(0.2, 0.1, 0.3));
         m_pcBox->AddLED(CVector3(0.1, 0.0, 0.2), CColor::RED);
         m_pcBox->EnableLEDs(GetSimulator().GetMedium<CLEDMedium>("leds"));
         AddEntity(*m_pcBox);
         AddEntity(*new CCylinderEntity("post", CVector3(-0.5, 0.5, 0.0), CQuaternion(), false, 0.1, 0.2));
         AddEntity(*new CLightEntity("lamp", CVector3(0.0, 0.0, 0.5), CColor::YELLOW, 2.5));
      }
      UInt32 unEdges;
      GetNodeAttributeOrDefault(tParams, "edges", unEdges, (UInt32) 0);
      if(unEdges > 0) {
         CArenaEntity* pcArena = new CArenaEntity("walls", CVector3(), CQuaternion(), CVector3(0.01, 0.5, 0.1), "leds",
                                                  2, unEdges, 0.25, 1.0);
         pcArena->AddWall(*new CWallEntity(pcArena, "across", CVector3(0.2, 0.1, 0.0),
                                           CQuaternion(CRadians::PI_OVER_FOUR, CVector3::Z),
                                           CVector3(0.01, 0.25, 0.1), "leds", 2, 0.125, 1.0));
         AddEntity(*pcArena);
         pcArena->SetArenaColor(CColor::BLUE);
         pcArena->SetBoxColor(1, 2, CColor::RED);
         pcArena->SetWallColor(unEdges + 1, CColor::GREEN);
         LOG << GetSpace().GetEntitiesByType("block").size() << " blocks" << std::endl;
      }
      MoveRobots();
      Fail("Init");
   }

   virtual void Reset() {
      m_fScore = 0.0;
      MoveRobots();
      LOG << "reset" << std::endl;
      Fail("Reset");
   }

   virtual void Destroy() {
      LOG << "destroyed" << std::endl;
      if(GetSpace().GetEntityMapPerId().count("walls") > 0) RemoveEntity("walls");
      Fail("Destroy");
   }

   virtual void PreStep() {
      Fail("PreStep");
      UInt32 unClock = GetSpace().GetSimulationClock();
      if(m_bRestless) m_fEdge = -0.02 * unClock;
      if(m_bRestless && unClock % 5 == 4) MoveRobots();
      if(unClock == 1) LOG << "first\tstep\rfinished at " << unClock << std::endl;
      if(m_bMove && unClock == 5) {
         MoveEntity(m_pcBox->GetEmbodiedEntity(), CVector3(0.6, 0.6, 0.0), CQuaternion());
         CLightEntity& cLamp = dynamic_cast<CLightEntity&>(GetSpace().GetEntity("lamp"));
         m_pcBox->GetLEDEquippedEntity().SetAllLEDsColors(CColor::GREEN);
         cLamp.SetColor(CColor::BLUE);
         cLamp.SetIntensity(1.25);
         RemoveEntity("post");
         m_fEdge = 0.3;
         GetSpace().GetFloorEntity().SetChanged();
      }
   }

   virtual void PostStep() {
      Fail("PostStep");
      if(m_bRestless && GetSpace().GetSimulationClock() % 7 == 3) MoveRobots();
      if(m_bRestless && GetSpace().GetSimulationClock() == 12) LOG << "twelve" << std::endl;
      CSpace::TMapPerType& tEpuckMap = GetSpace().GetEntitiesByType("epuck");
      for(CSpace::TMapPerType::iterator it = tEpuckMap.begin(); it != tEpuckMap.end(); ++it) {
         CEPuckEntity* pcEpuck = any_cast<CEPuckEntity*>(it->second);
         if(pcEpuck->GetLEDEquippedEntity().GetLED(10).GetColor() == CColor::CYAN) {
            LOG << pcEpuck->GetId() << " shines at " << GetSpace().GetSimulationClock() << std::endl;
         }
         if(pcEpuck->GetEmbodiedEntity().GetOriginAnchor().Position.GetX() > m_fEdge) m_fScore += 1.0;
      }
   }

   virtual bool IsExperimentFinished() {
      Fail("IsExperimentFinished");
      return m_unEnd > 0 && GetSpace().GetSimulationClock() >= m_unEnd;
   }

   virtual void PostExperiment() {
      Fail("PostExperiment");
      LOG << "Score = " << m_fScore + 0.5 << std::endl;
      LOG << "the end is near" << std::endl;
   }

   virtual CColor GetFloorColor(const CVector2& c_position) {
      Fail("GetFloorColor");
      if(m_bRestless && GetSpace().GetSimulationClock() == 9) LOG << "asked" << std::endl;
      return c_position.GetX() > m_fEdge ? CColor::BLACK : CColor(10, 20, 30);
   }

   Real GetObjectiveFunction() {
      return m_fScore;
   }

private:
   void MoveRobots() {
      CSpace::TMapPerType& tEpuckMap = GetSpace().GetEntitiesByType("epuck");
      for(CSpace::TMapPerType::iterator it = tEpuckMap.begin(); it != tEpuckMap.end(); ++it) {
         CEPuckEntity* pcEpuck = any_cast<CEPuckEntity*>(it->second);
         bool bPlaced = false;
         for(UInt32 i = 0; !bPlaced && i < 100; ++i) {
            bPlaced = MoveEntity(pcEpuck->GetEmbodiedEntity(),
                                 CVector3(m_pcRng->Uniform(CRange<Real>(-0.2, 0.2)),
                                          m_pcRng->Uniform(CRange<Real>(-0.2, 0.2)), 0.0),
                                 CQuaternion().FromEulerAngles(m_pcRng->Uniform(CRadians::UNSIGNED_RANGE),
                                                               CRadians::ZERO, CRadians::ZERO),
                                 false);
         }
         if(!bPlaced) THROW_ARGOSEXCEPTION("Can't place robot");
      }
   }

   void Fail(const std::string& str_where) {
      if(str_where != m_strFailsIn || GetSpace().GetSimulationClock() < m_unFailsFrom) return;
      if(m_strHow == "throw") THROW_ARGOSEXCEPTION("thrown in " << str_where);
      if(m_strHow == "crash") ::raise(SIGSEGV);
      if(m_strHow == "hang") for(;;) ::pause();
      if(m_strHow == "controller") {
         GetSpace().IterateOverControllableEntities([](CControllableEntity* pc_entity) { pc_entity->GetController(); });
      }
      if(m_strHow == "robot") AddEntity(*new CEPuckEntity("another", "c"));
   }

   CRandom::CRNG* m_pcRng;
   CBoxEntity* m_pcBox;
   Real m_fScore, m_fEdge;
   UInt32 m_unEnd, m_unFailsFrom;
   bool m_bMove, m_bRestless;
   std::string m_strFailsIn, m_strHow;
};

REGISTER_LOOP_FUNCTIONS(CMission, "mission")
