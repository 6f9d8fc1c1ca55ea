/* SPDX-License-Identifier: MIT */
#include "counter.h"

#include <argos3/core/utility/logging/argos_log.h>

UInt32 CCounter::s_unAll = 0;

void CCounter::Init(TConfigurationNode& t_tree) {
   s_unAll = 0;
   m_sWork.SetSteps(0);
   m_sWork.Sum = 0.0;
   m_strState = "begun";
   m_pcRng = CRandom::CreateRNG("argos");
   bool bFails = false;
   GetNodeAttributeOrDefault(t_tree, "fails", bFails, bFails);
   if(bFails) THROW_ARGOSEXCEPTION("told to fail");
}

void CCounter::ControlStep() {
   m_pcRng->Uniform(CRange<Real>(0.0, 1.0));
   ++m_sWork.Steps;
   ++s_unAll;
   m_sWork.Sum += m_fGoal;
   m_strState = "at work";
}

void CCounter::Destroy() {
   m_strState = "ended";
}

void CCounter::SetGoal(Real f_goal) {
   LOG << GetId() << ", " << m_strState << ", has a goal" << std::endl;
   m_fGoal = f_goal;
}

size_t CCounter::CountProximity() {
   if(m_pcProximity == NULL) m_pcProximity = GetSensor<CCI_EPuckProximitySensor>("epuck_proximity");
   return m_pcProximity->GetReadings().size();
}

REGISTER_CONTROLLER(CCounter, "counter")
