/* SPDX-License-Identifier: MIT */
/*
 * rings.hpp - sensors around the body and below it: proximity, light and ground, of the e-puck, of
 * any robot, of the Khepera IV, and of the foot-bot, whose 24 are made of 8 where the robot is an e-puck.
 */
#ifndef VS_ARGOS_RINGS_HPP
#define VS_ARGOS_RINGS_HPP

#include "controller.hpp"

namespace argos {

/* A sensor that looks in one direction, counter-clockwise from straight ahead. */
struct VsRingReading
{
    Real Value;
    CRadians Angle;

    VsRingReading() : Value(0.0) {}
    VsRingReading(Real value, const CRadians &angle) : Value(value), Angle(angle) {}
};

inline std::ostream &operator<<(std::ostream &out, const VsRingReading &reading)
{
    return out << "SReading(" << reading.Value << "," << reading.Angle << ")";
}

inline std::ostream &operator<<(std::ostream &out, const std::vector<VsRingReading> &readings)
{
    for (size_t i = 0; i < readings.size(); ++i)
        out << (i > 0 ? " " : "") << readings[i];
    return out;
}

enum VsRingKind { VS_PROXIMITY, VS_LIGHT };

/* The robot's values in ARGoS's order, counter-clockwise from the front left, 0 to 1. */
class VsRing
{
public:
    static const int SENSORS = 8; /* an e-puck's */
    static const int MOST = 64;

    VsRing() : m_count(0) {}
    /* The same as ARGoS's readings of the robot's own ring. False: nothing was measured yet. */
    bool Read(vs_robot *robot, int handle, VsRingKind kind, bool is_raw = true);
    Real operator[](size_t i) const { return m_values[i]; }
    size_t Count() const { return m_count; }
    /* In any direction: between the two of an e-puck's sensors beside it. */
    Real At(const CRadians &angle) const;
    /* What argos3-epuck says where sensor i looks: 0 to 2 pi. */
    static CRadians AngleOf(size_t i);

private:
    size_t m_count;
    Real m_values[MOST];
};

/* A ring whose readings have their angle. */
template <VsRingKind KIND, size_t SENSORS> class VsRingSensor : public CCI_Sensor
{
public:
    typedef VsRingReading SReading;
    typedef std::vector<SReading> TReadings;

    VsRingSensor() : m_tReadings(SENSORS) {}
    const TReadings &GetReadings() const { return m_tReadings; }
    const SReading &GetReading(UInt16 i) const { return m_tReadings[i]; }

    void VsUpdate(vs_robot *robot) override
    {
        VsRing ring;
        if (!ring.Read(robot, m_handle, KIND))
            return;
        for (size_t i = 0; i < SENSORS; ++i)
            m_tReadings[i].Value = ring.Count() == SENSORS ? ring[i] : ring.At(m_tReadings[i].Angle);
    }

protected:
    TReadings m_tReadings;
};

template <VsRingKind KIND> class VsEPuckRing : public VsRingSensor<KIND, 8>
{
public:
    VsEPuckRing()
    {
        for (size_t i = 0; i < this->m_tReadings.size(); ++i)
            this->m_tReadings[i].Angle = VsRing::AngleOf(i);
    }
};

class CCI_EPuckProximitySensor : public VsEPuckRing<VS_PROXIMITY>
{
public:
    static const char *VsNameOf(const std::string &element)
    {
        return element == "epuck_proximity" ? "proximity" : nullptr;
    }
};

class CCI_EPuckLightSensor : public VsEPuckRing<VS_LIGHT>
{
public:
    static const char *VsNameOf(const std::string &element)
    {
        return element == "epuck_light" ? "light" : nullptr;
    }
};

/* Evenly spaced, signed angles. */
template <VsRingKind KIND> class VsFootBotRing : public VsRingSensor<KIND, 24>
{
public:
    VsFootBotRing()
    {
        for (size_t i = 0; i < this->m_tReadings.size(); ++i)
            this->m_tReadings[i].Angle = CRadians(ARGOS_PI / 12.0 * (i + 0.5)).SignedNormalize();
    }
};

/* Evenly spaced from straight ahead. */
class CCI_KheperaIVProximitySensor : public VsRingSensor<VS_PROXIMITY, 8>
{
public:
    CCI_KheperaIVProximitySensor()
    {
        for (size_t i = 0; i < m_tReadings.size(); ++i)
            m_tReadings[i].Angle = CRadians(ARGOS_PI / 4.0 * i).SignedNormalize();
    }
    static const char *VsNameOf(const std::string &element)
    {
        return element == "kheperaiv_proximity" ? "proximity" : nullptr;
    }
};

class CCI_FootBotProximitySensor : public VsFootBotRing<VS_PROXIMITY>
{
public:
    static const char *VsNameOf(const std::string &element)
    {
        return element == "footbot_proximity" ? "proximity" : nullptr;
    }
};

class CCI_FootBotLightSensor : public VsFootBotRing<VS_LIGHT>
{
public:
    static const char *VsNameOf(const std::string &element)
    {
        return element == "footbot_light" ? "light" : nullptr;
    }
};

/* Readings without angles. */
template <VsRingKind KIND> class VsPlainRing : public CCI_Sensor
{
public:
    VsPlainRing() : m_tReadings(VsRing::SENSORS, 0.0), m_is_raw(true) {}
    const std::vector<Real> &GetReadings() const { return m_tReadings; }

    bool VsBind(vs_robot *robot, const std::string &element, const char *name) override
    {
        /* IRIDIA's virtual light sensor sends readings, not what a converter would measure. */
        m_is_raw = element.find("virtual") == std::string::npos;
        m_tReadings.assign(VsCountOf(robot, "vs:ring", VsRing::SENSORS), 0.0);
        return CCI_Sensor::VsBind(robot, element, name);
    }

    void VsUpdate(vs_robot *robot) override
    {
        VsRing ring;
        if (!ring.Read(robot, m_handle, KIND, m_is_raw))
            return;
        for (size_t i = 0; i < m_tReadings.size() && i < ring.Count(); ++i)
            m_tReadings[i] = ring[i];
    }

protected:
    std::vector<Real> m_tReadings;

private:
    bool m_is_raw;
};

class CCI_ProximitySensor : public VsPlainRing<VS_PROXIMITY>
{
public:
    static const char *VsNameOf(const std::string &element)
    {
        return element == "proximity" ? "proximity" : nullptr;
    }
};

class CCI_LightSensor : public VsPlainRing<VS_LIGHT>
{
public:
    static const char *VsNameOf(const std::string &element)
    {
        return element == "light" || element == "virtual_light_sensor" ? "light" : nullptr;
    }
};

/* The three below the front: left, centre, right. */
class CCI_EPuckGroundSensor : public CCI_Sensor
{
public:
    struct SReadings
    {
        Real Left, Center, Right;

        SReadings() : Left(0.0), Center(0.0), Right(0.0) {}
        void Reset() { *this = SReadings(); }
        Real &operator[](size_t i);
        const Real &operator[](size_t i) const { return const_cast<SReadings &>(*this)[i]; }
    };

    static const char *VsNameOf(const std::string &element);
    const SReadings &GetReadings() const { return m_sReadings; }
    void GetReadings(Real *values) const
    {
        for (size_t i = 0; i < 3; ++i)
            values[i] = m_sReadings[i];
    }
    Real GetReading(size_t i) { return m_sReadings[i]; }
    void VsUpdate(vs_robot *robot) override;

protected:
    SReadings m_sReadings;
};

/* The same three, in the order of ARGoS's e-puck: right, centre, left; or all that the robot has. */
class CCI_GroundSensor : public CCI_Sensor
{
public:
    CCI_GroundSensor() : m_tReadings(3, 0.0) {}
    static const char *VsNameOf(const std::string &element);
    bool VsBind(vs_robot *robot, const std::string &element, const char *name) override;
    const std::vector<Real> &GetReadings() const { return m_tReadings; }
    void VsUpdate(vs_robot *robot) override;

protected:
    std::vector<Real> m_tReadings;
};

/* The foot-bot's sensors below it: of an e-puck each reads what the one on its side does. */
struct VsGroundReading
{
    Real Value;
    CVector2 Offset; /* [cm] */

    VsGroundReading() : Value(0.0) {}
    VsGroundReading(Real value, const CVector2 &offset) : Value(value), Offset(offset) {}
};

inline std::ostream &operator<<(std::ostream &out, const VsGroundReading &reading)
{
    return out << "Value=<" << reading.Value << ">, Offset=<" << reading.Offset << ">";
}

class VsFootBotGround : public CCI_Sensor
{
public:
    typedef VsGroundReading SReading;
    typedef std::vector<SReading> TReadings;

    const TReadings &GetReadings() const { return m_tReadings; }
    void VsUpdate(vs_robot *robot) override;

protected:
    TReadings m_tReadings;
};

class CCI_FootBotMotorGroundSensor : public VsFootBotGround
{
public:
    CCI_FootBotMotorGroundSensor();
    static const char *VsNameOf(const std::string &element)
    {
        return element == "footbot_motor_ground" ? "ground" : nullptr;
    }
};

class CCI_FootBotBaseGroundSensor : public VsFootBotGround
{
public:
    CCI_FootBotBaseGroundSensor();
    bool VsBind(vs_robot *robot, const std::string &element, const char *name) override;
    void VsUpdate(vs_robot *robot) override;
    static const char *VsNameOf(const std::string &element)
    {
        return element == "footbot_base_ground" ? "ground" : nullptr;
    }

private:
    bool m_is_own;
};

}  // namespace argos

#endif
