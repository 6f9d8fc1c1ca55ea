/* SPDX-License-Identifier: MIT */
/*
 * neighbours.cpp - range and bearing, and the camera: see neighbours.hpp.
 */
#include "neighbours.hpp"

#include "../layer.h"

namespace argos {

namespace {

const int NUMBERS_MAX = 512; /* more than a datagram holds */
const size_t PLACE_HEAD = 2; /* range and bearing */

const char *Named(const std::string &element, const char *wanted, const char *name)
{
    return element == wanted ? name : nullptr;
}

void Copy(UInt8 *to, const UInt8 *from)
{
    std::memcpy(to, from, CCI_EPuckRangeAndBearingActuator::MAX_BYTES_SENT);
}

}  // namespace

/* Defined for code that takes their address. */
const UInt32 CCI_EPuckRangeAndBearingSensor::MAX_BYTES_RECEIVED;
const UInt32 CCI_EPuckRangeAndBearingActuator::MAX_BYTES_SENT;

std::vector<Real> VsPlaces::Read(vs_robot *robot, size_t numbers) const
{
    Real values[NUMBERS_MAX];
    const int known = Min(vs_robot_values(robot, m_handle, values, 1), NUMBERS_MAX);
    if (known < 1)
        return std::vector<Real>();
    const size_t count = Min(static_cast<size_t>(values[0]) * numbers, static_cast<size_t>(known - 1));
    vs_robot_values(robot, m_handle, values, static_cast<int>(count) + 1);
    return std::vector<Real>(values + 1, values + 1 + count);
}

bool VsHearing::VsBind(vs_robot *robot, const std::string &element, const char *name)
{
    if (!VsPlaces::VsBind(robot, element, name))
        return false;
    m_two_radii_cm = vs_robot_param(robot, "vs:two_radii_cm", m_two_radii_cm);
    /* The robot's own board has four. */
    if (!vs_robot_is_own(m_handle))
        m_bytes = static_cast<size_t>(vs_robot_param(robot, "vs:heard_bytes", 4.0));
    return true;
}

const char *CCI_EPuckRangeAndBearingSensor::VsNameOf(const std::string &element)
{
    return Named(element, "epuck_range_and_bearing", "range_and_bearing");
}

void CCI_EPuckRangeAndBearingSensor::ClearPackets()
{
    for (SReceivedPacket *packet : m_tPackets)
        delete packet;
    m_tPackets.clear();
}

void CCI_EPuckRangeAndBearingSensor::VsUpdate(vs_robot *robot)
{
    const size_t size = PLACE_HEAD + m_bytes;
    const std::vector<Real> heard = Read(robot, size);
    ClearPackets();
    for (size_t at = 0; at + size <= heard.size(); at += size) {
        SReceivedPacket *packet = new SReceivedPacket;
        packet->Range = heard[at];
        packet->Bearing = CRadians(heard[at + 1]);
        for (size_t i = 0; i < m_bytes && i < MAX_BYTES_RECEIVED; ++i)
            packet->Data[i] = static_cast<UInt8>(heard[at + PLACE_HEAD + i]);
        m_tPackets.push_back(packet);
    }
}

const char *CCI_RangeAndBearingSensor::VsNameOf(const std::string &element)
{
    return Named(element, "range_and_bearing", "range_and_bearing");
}

/* Ranges of any robot are those between the centres. */
void CCI_RangeAndBearingSensor::VsUpdate(vs_robot *robot)
{
    const size_t size = PLACE_HEAD + m_bytes;
    const std::vector<Real> heard = Read(robot, size);
    m_tReadings.clear();
    for (size_t at = 0; at + size <= heard.size(); at += size) {
        SPacket packet;
        packet.Range = heard[at] + m_two_radii_cm;
        packet.HorizontalBearing = CRadians(heard[at + 1]);
        packet.Data.Resize(m_bytes);
        for (size_t i = 0; i < m_bytes; ++i)
            packet.Data[i] = static_cast<UInt8>(heard[at + PLACE_HEAD + i]);
        m_tReadings.push_back(packet);
    }
}

bool VsSaying::VsBind(vs_robot *robot, const std::string &, const char *name)
{
    m_handle = vs_robot_actuator(robot, name);
    return m_handle >= 0;
}

void VsSaying::Say(vs_robot *robot, const UInt8 *bytes, size_t count) const
{
    vs_robot_actuate(robot, m_handle, 0, static_cast<Real>(count));
    for (size_t i = 0; i < count; ++i)
        vs_robot_actuate(robot, m_handle, static_cast<int>(i) + 1, bytes[i]);
}

const char *CCI_EPuckRangeAndBearingActuator::VsNameOf(const std::string &element)
{
    return Named(element, "epuck_range_and_bearing", "message");
}

void CCI_EPuckRangeAndBearingActuator::SetData(const TData data)
{
    m_sDesiredData.State = STATE_ALL_EMITTERS_SAME_DATA;
    for (SEmitter &emitter : m_sDesiredData.Emitter) {
        emitter.Enabled = true;
        Copy(emitter.Data, data);
    }
}

void CCI_EPuckRangeAndBearingActuator::SetDataForEmitter(size_t emitter, const TData data)
{
    if (emitter >= sizeof m_sDesiredData.Emitter / sizeof m_sDesiredData.Emitter[0])
        return;
    m_sDesiredData.State = STATE_EMITTERS_DIFFERENT;
    m_sDesiredData.Emitter[emitter].Enabled = true;
    Copy(m_sDesiredData.Emitter[emitter].Data, data);
}

void CCI_EPuckRangeAndBearingActuator::DisableEmitter(size_t emitter)
{
    m_sDesiredData.State = STATE_EMITTERS_DIFFERENT;
    if (emitter < sizeof m_sDesiredData.Emitter / sizeof m_sDesiredData.Emitter[0])
        m_sDesiredData.Emitter[emitter].Enabled = false;
}

void CCI_EPuckRangeAndBearingActuator::Disable()
{
    m_sDesiredData.State = STATE_ALL_EMITTERS_DISABLED;
    for (SEmitter &emitter : m_sDesiredData.Emitter)
        emitter.Enabled = false;
}

void CCI_EPuckRangeAndBearingActuator::VsUpdate(vs_robot *robot)
{
    for (const SEmitter &emitter : m_sDesiredData.Emitter)
        if (emitter.Enabled) {
            Say(robot, emitter.Data, MAX_BYTES_SENT);
            return;
        }
    Say(robot, nullptr, 0);
}

const char *CCI_RangeAndBearingActuator::VsNameOf(const std::string &element)
{
    return Named(element, "range_and_bearing", "message");
}

bool CCI_RangeAndBearingActuator::VsBind(vs_robot *robot, const std::string &element,
                                         const char *name)
{
    m_cData.Resize(static_cast<size_t>(vs_robot_param(robot, "vs:said_bytes", 4.0)));
    m_cData.Zero();
    return VsSaying::VsBind(robot, element, name);
}

void CCI_RangeAndBearingActuator::SetData(const CByteArray &data)
{
    if (data.Size() != m_cData.Size())
        THROW_ARGOSEXCEPTION("CCI_RangeAndBearingActuator::SetData() : data size does not match, "
                             "expected " << m_cData.Size() << ", got " << data.Size());
    m_cData = data;
}

void CCI_RangeAndBearingActuator::VsUpdate(vs_robot *robot)
{
    Say(robot, m_cData.Size() > 0 ? &m_cData[0] : nullptr, m_cData.Size());
}

const char *CCI_EPuckIRComSensor::VsNameOf(const std::string &element)
{
    return Named(element, "epuck_ircom", "ircom");
}

const char *CCI_EPuckIRComActuator::VsNameOf(const std::string &element)
{
    return Named(element, "epuck_ircom", "ircom");
}

const char *CCI_EPuckOmnidirectionalCameraSensor::VsNameOf(const std::string &element)
{
    return Named(element, "epuck_omnidirectional_camera", "omnidirectional_camera");
}

const char *CCI_ColoredBlobOmnidirectionalCameraSensor::VsNameOf(const std::string &element)
{
    return Named(element, "colored_blob_omnidirectional_camera", "omnidirectional_camera");
}

}  // namespace argos
