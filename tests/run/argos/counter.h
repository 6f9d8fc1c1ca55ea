/* SPDX-License-Identifier: MIT */
/* counter.h - a controller whose members loop functions use, as published ones do. */
#ifndef COUNTER_H
#define COUNTER_H

#include <argos3/core/control_interface/ci_controller.h>
#include <argos3/core/utility/math/rng.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_proximity_sensor.h>

using namespace argos;

class CCounter : public CCI_Controller {
public:
   struct SWork {
      UInt32 Steps;
      Real Sum;
      unsigned SetSteps(unsigned un_steps) { Steps = un_steps; /* no return: published */ }
   };

   CCounter() : m_fGoal(0.0), m_pcRng(NULL), m_pcProximity(NULL) {}
   virtual void Init(TConfigurationNode& t_tree);
   virtual void ControlStep();
   virtual void Destroy();

   void SetGoal(Real f_goal);
   size_t CountProximity();
   SWork& GetWork() { return m_sWork; }
   const std::string& GetState() const { return m_strState; }

   static UInt32 s_unAll;

private:
   SWork m_sWork;
   Real m_fGoal;
   std::string m_strState;
   CRandom::CRNG* m_pcRng;
   CCI_EPuckProximitySensor* m_pcProximity;
};

#endif
