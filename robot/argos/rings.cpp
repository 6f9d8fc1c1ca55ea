/* SPDX-License-Identifier: MIT */
/*
 * rings.cpp - sensors around the body and below it: see rings.hpp.
 */
#include "rings.hpp"

#include "../layer.h"

namespace argos {

namespace {

const Real RAW_MAX = 4096.0; /* of the base's converter */
const size_t BELOW_MOST = 32;

Real BlackOrWhite(Real grey)
{
    return grey < 0.5 ? 0.0 : 1.0;
}

/*
 * What ARGoS reads where the e-puck's own ring reads raw: 298.701 d^2 - 36.8961 d + 1.08212 at the
 * distance d [m] at which it reads so, 0 from 5 cm on. Sources: argos3-epuck 66cb8d9
 * epuck_proximity_default_sensor.cpp; epuck.md section 6, from Webots. Noise where nothing is
 * near stays below the first of these.
 */
const struct
{
    Real raw, value;
} OWN_PROXIMITY[] = {{120.0, 0.0},     {158.0, 0.0842},  {235.0, 0.2441},  {384.0, 0.4637},
                     {601.0, 0.5959},  {1466.0, 0.7430}, {2133.0, 0.9051}, {4095.0, 1.0}};

Real OwnProximity(Real raw)
{
    const size_t last = sizeof OWN_PROXIMITY / sizeof OWN_PROXIMITY[0] - 1;
    size_t i = 1;
    if (raw <= OWN_PROXIMITY[0].raw)
        return 0.0;
    if (raw >= OWN_PROXIMITY[last].raw)
        return 1.0;
    while (raw > OWN_PROXIMITY[i].raw)
        ++i;
    const Real share = (raw - OWN_PROXIMITY[i - 1].raw) /
                       (OWN_PROXIMITY[i].raw - OWN_PROXIMITY[i - 1].raw);
    return OWN_PROXIMITY[i - 1].value +
           share * (OWN_PROXIMITY[i].value - OWN_PROXIMITY[i - 1].value);
}

Real Clipped(Real value)
{
    return value > 1.0 ? 1.0 : value < 0.0 ? 0.0 : value;
}

}  // namespace

bool VsRing::Read(vs_robot *robot, int handle, VsRingKind kind, bool is_raw)
{
    Real raw[MOST];
    const int count = Min(vs_robot_values(robot, handle, raw, MOST), +MOST);
    if (count < SENSORS)
        return false;
    /* An e-puck counts clockwise from the front right; behind its own eight there may be angles. */
    m_count = static_cast<size_t>(count == 3 * SENSORS ? count : +SENSORS);
    for (size_t i = 0; i < m_count; ++i) {
        const Real value = raw[m_count == SENSORS ? SENSORS - 1 - i : i];
        if (kind == VS_PROXIMITY && vs_robot_is_own(handle))
            m_values[i] = OwnProximity(value);
        else
            m_values[i] = is_raw ? Clipped(value / RAW_MAX) : value;
    }
    return true;
}

CRadians VsRing::AngleOf(size_t i)
{
    static const float PARTS[SENSORS] = {10.5884f, 3.5999f, 2.0f,    1.2f,
                                         0.8571f,  0.6667f, 0.5806f, 0.5247f};
    return CRadians(ARGOS_PI / static_cast<Real>(PARTS[i]));
}

Real VsRing::At(const CRadians &angle) const
{
    const Real wanted = CRadians(angle).UnsignedNormalize().GetValue();
    Real before = AngleOf(SENSORS - 1).GetValue() - 2.0 * ARGOS_PI;
    for (size_t i = 0; i <= SENSORS; ++i) {
        const Real here = i < SENSORS ? AngleOf(i).GetValue() : AngleOf(0).GetValue() + 2.0 * ARGOS_PI;
        if (wanted <= here) {
            const Real share = (wanted - before) / (here - before);
            return (1.0 - share) * m_values[(i + SENSORS - 1) % SENSORS] +
                   share * m_values[i % SENSORS];
        }
        before = here;
    }
    return 0.0;
}

Real &CCI_EPuckGroundSensor::SReadings::operator[](size_t i)
{
    if (i > 2)
        THROW_ARGOSEXCEPTION("The ground sensor has the readings 0 to 2, asked for: " << i);
    return i == 0 ? Left : i == 1 ? Center : Right;
}

const char *CCI_EPuckGroundSensor::VsNameOf(const std::string &element)
{
    return element == "epuck_ground" || element == "epuck_virtual_ground_sensor" ? "ground" : nullptr;
}

void CCI_EPuckGroundSensor::VsUpdate(vs_robot *robot)
{
    Real values[3];
    if (vs_robot_values(robot, m_handle, values, 3) >= 3)
        for (size_t i = 0; i < 3; ++i)
            m_sReadings[i] = values[i];
}

const char *CCI_GroundSensor::VsNameOf(const std::string &element)
{
    return element == "ground" || element == "virtual_ground_sensor" ? "ground" : nullptr;
}

bool CCI_GroundSensor::VsBind(vs_robot *robot, const std::string &element, const char *name)
{
    m_tReadings.assign(VsCountOf(robot, "vs:below", 3), 0.0);
    return CCI_Sensor::VsBind(robot, element, name);
}

void CCI_GroundSensor::VsUpdate(vs_robot *robot)
{
    Real values[BELOW_MOST];
    const size_t count = m_tReadings.size();
    if (vs_robot_values(robot, m_handle, values, static_cast<int>(count)) < static_cast<int>(count))
        return;
    for (size_t i = 0; i < count; ++i)
        m_tReadings[i] = count == 3       ? values[2 - i]
                         : i + 8 >= count ? BlackOrWhite(values[i])
                                          : values[i];
}

void VsFootBotGround::VsUpdate(vs_robot *robot)
{
    Real values[BELOW_MOST];
    const int count = vs_robot_values(robot, m_handle, values, static_cast<int>(m_tReadings.size()));
    if (count < 3)
        return;
    for (size_t i = 0; i < m_tReadings.size(); ++i) {
        const Real left = m_tReadings[i].Offset.GetY();
        m_tReadings[i].Value = count == static_cast<int>(m_tReadings.size()) ? values[i]
                               : left > 0.0                                  ? values[0]
                               : left < 0.0                                  ? values[2]
                                                                             : values[1];
    }
}

/* Those of a foot-bot itself have a name of their own, and are black or white. */
bool CCI_FootBotBaseGroundSensor::VsBind(vs_robot *robot, const std::string &element,
                                         const char *name)
{
    m_is_own = VsCountOf(robot, "vs:bases", 0) > 0;
    return CCI_Sensor::VsBind(robot, element, m_is_own ? "base_ground" : name);
}

void CCI_FootBotBaseGroundSensor::VsUpdate(vs_robot *robot)
{
    VsFootBotGround::VsUpdate(robot);
    for (SReading &reading : m_tReadings)
        reading.Value = m_is_own ? BlackOrWhite(reading.Value) : reading.Value;
}

CCI_FootBotMotorGroundSensor::CCI_FootBotMotorGroundSensor()
{
    static const Real AT[][2] = {{6.3, 1.16}, {-6.3, 1.16}, {-6.3, -1.16}, {6.3, -1.16}};
    for (const Real *at : AT)
        m_tReadings.push_back(SReading(0.0, CVector2(at[0], at[1])));
}

CCI_FootBotBaseGroundSensor::CCI_FootBotBaseGroundSensor() : m_is_own(false)
{
    static const Real AT[][2] = {{8.0, 0.0},  {4.2, 6.5},   {0.0, 8.0},  {-4.2, 6.5},
                                 {-8.0, 0.0}, {-4.2, -6.5}, {0.0, -8.0}, {4.2, -6.5}};
    for (const Real *at : AT)
        m_tReadings.push_back(SReading(0.0, CVector2(at[0], at[1])));
}

}  // namespace argos
