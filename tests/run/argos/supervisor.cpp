/* SPDX-License-Identifier: MIT */
/* supervisor.cpp - loop functions that use the objects of controllers. */
#include <argos3/core/simulator/loop_functions.h>
#include <argos3/core/simulator/simulator.h>
#include <argos3/core/simulator/entity/controllable_entity.h>
#include <argos3/core/utility/logging/argos_log.h>
#include <argos3/plugins/robots/e-puck/simulator/epuck_entity.h>

#include "counter.h"

class CSupervisor : public CLoopFunctions {
public:
   virtual void Init(TConfigurationNode&) {
      Real fGoal = 0.5;
      m_pcRng = CRandom::CreateRNG("argos");
      CSpace::TMapPerType& tEPucks = GetSpace().GetEntitiesByType("epuck");
      for(CSpace::TMapPerType::iterator it = tEPucks.begin(); it != tEPucks.end(); ++it) {
         Controller(*any_cast<CEPuckEntity*>(it->second)).SetGoal(fGoal);
         fGoal *= 2.0;
      }
   }

   virtual void PreStep() { Show(); }

   virtual void PostExperiment() { Show(true); }

   virtual void Destroy() { m_pcRng->Uniform(CRange<Real>(0.0, 1.0)); }

private:
   CCounter& Controller(CEPuckEntity& c_epuck) {
      return dynamic_cast<CCounter&>(c_epuck.GetControllableEntity().GetController());
   }

   void Show(bool b_always = false) {
      if(GetSpace().GetSimulationClock() != 10 && !b_always) return;
      CSpace::TMapPerType& tEPucks = GetSpace().GetEntitiesByType("epuck");
      for(CSpace::TMapPerType::iterator it = tEPucks.begin(); it != tEPucks.end(); ++it) {
         CCounter& cCounter = Controller(*any_cast<CEPuckEntity*>(it->second));
         LOG << cCounter.GetId() << " " << cCounter.GetState() << " " << cCounter.GetWork().Steps << " "
             << cCounter.GetWork().Sum << " of " << CCounter::s_unAll << ", " << cCounter.CountProximity()
             << std::endl;
      }
   }

   CRandom::CRNG* m_pcRng;
};

REGISTER_LOOP_FUNCTIONS(CSupervisor, "supervisor")
