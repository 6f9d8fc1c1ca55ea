/* SPDX-License-Identifier: MIT */
/*
 * devices.hpp - the other sensors and actuators: wheels, LEDs, range and bearing, the camera,
 * battery, encoders, place; of the e-puck and of any robot.
 */
#ifndef VS_ARGOS_DEVICES_HPP
#define VS_ARGOS_DEVICES_HPP

#include <limits>

#include "controller.hpp"

namespace argos {

/* Speeds are in cm/s. */
class VsWheels : public CCI_Actuator
{
public:
    VsWheels() : m_fCurrentVelocity() {}
    virtual void SetLinearVelocity(Real left, Real right)
    {
        m_fCurrentVelocity[0] = left;
        m_fCurrentVelocity[1] = right;
    }
    void Reset() override { SetLinearVelocity(0.0, 0.0); }
    void VsUpdate(vs_robot *robot) override;

protected:
    Real m_fCurrentVelocity[2];
};

class CCI_EPuckWheelsActuator : public VsWheels
{
public:
    static const Real MAX_VELOCITY_CM_SEC;
    static const Real MIN_VELOCITY_CM_SEC;

    static const char *VsNameOf(const std::string &element);
};

class CCI_DifferentialSteeringActuator : public VsWheels
{
public:
    static const char *VsNameOf(const std::string &element);
};

/* What both kinds of wheel sensors measure: since the step before, in cm and cm/s. */
class VsOdometer : public CCI_Sensor
{
public:
    VsOdometer() : m_axis_cm(5.3), m_covered_cm(), m_is_known(false), m_way_cm() {}
    bool VsBind(vs_robot *robot, const std::string &element, const char *name) override;
    void VsUpdate(vs_robot *robot) override;

protected:
    Real m_axis_cm;
    Real m_covered_cm[2];

private:
    bool m_is_known;
    Real m_way_cm[2];
};

class CCI_EPuckEncoderSensor : public VsOdometer
{
public:
    static const Real WHEEL_AXIS_LENGTH;

    struct SReading
    {
        Real CoveredDistanceLeftWheel, CoveredDistanceRightWheel;

        SReading(Real left = 0.0, Real right = 0.0)
            : CoveredDistanceLeftWheel(left), CoveredDistanceRightWheel(right)
        {
        }
    };

    static const char *VsNameOf(const std::string &element);
    virtual const SReading &GetReading() const { return m_sReading; }
    void VsUpdate(vs_robot *robot) override;

protected:
    SReading m_sReading;
};

class CCI_DifferentialSteeringSensor : public VsOdometer
{
public:
    struct SReading
    {
        Real VelocityLeftWheel, VelocityRightWheel;
        Real CoveredDistanceLeftWheel, CoveredDistanceRightWheel;
        Real WheelAxisLength;

        SReading(Real left_speed = 0.0, Real right_speed = 0.0, Real left = 0.0, Real right = 0.0,
                 Real axis = 0.0)
            : VelocityLeftWheel(left_speed), VelocityRightWheel(right_speed),
              CoveredDistanceLeftWheel(left), CoveredDistanceRightWheel(right),
              WheelAxisLength(axis)
        {
        }
    };

    static const char *VsNameOf(const std::string &element);
    const SReading &GetReading() const { return m_sReading; }
    void VsUpdate(vs_robot *robot) override;

protected:
    SReading m_sReading;
};

class CCI_FootBotEncoderSensor : public VsOdometer
{
public:
    struct SReading
    {
        Real CoveredDistanceLeftWheel, CoveredDistanceRightWheel, WheelAxisLength;

        SReading(Real left = 0.0, Real right = 0.0, Real axis = 0.0)
            : CoveredDistanceLeftWheel(left), CoveredDistanceRightWheel(right), WheelAxisLength(axis)
        {
        }
    };

    static const char *VsNameOf(const std::string &element);
    const SReading &GetReading() const { return m_sReading; }
    void VsUpdate(vs_robot *robot) override;

protected:
    SReading m_sReading;
};

/* The red ring; LED 0 is ahead, and they count counter-clockwise. */
class CCI_EPuckBaseLEDsActuator : public CCI_Actuator
{
public:
    CCI_EPuckBaseLEDsActuator() : m_unLEDSettings(0), m_virtual(-1) {}
    static const char *VsNameOf(const std::string &element);
    virtual void SwitchLED(size_t led, bool on);
    virtual void SwitchLEDs(bool on) { m_unLEDSettings = on ? 255 : 0; }
    void Reset() override { SwitchLEDs(false); }
    bool VsBind(vs_robot *robot, const std::string &element, const char *name) override;
    void VsUpdate(vs_robot *robot) override;

protected:
    UInt8 m_unLEDSettings;

private:
    int m_virtual;
};

/* Coloured lights: the robot's own where it has some, and those that virtual cameras see. */
class VsLights : public CCI_Actuator
{
public:
    typedef std::vector<CColor> TLEDSettings;

    explicit VsLights(size_t count) : m_tSettings(count, CColor::BLACK), m_virtual(-1) {}
    void Reset() override { m_tSettings.assign(m_tSettings.size(), CColor::BLACK); }
    bool VsBind(vs_robot *robot, const std::string &element, const char *name) override;

protected:
    void ShowVirtual(vs_robot *robot) const;

    TLEDSettings m_tSettings;

private:
    int m_virtual;
};

/* Front left, front right, back. */
class CCI_EPuckRGBLEDsActuator : public VsLights
{
public:
    CCI_EPuckRGBLEDsActuator() : VsLights(3) {}
    static const char *VsNameOf(const std::string &element);
    virtual void SetColor(size_t led, const CColor &color)
    {
        if (led < m_tSettings.size())
            m_tSettings[led] = color;
    }
    virtual void SetColors(const CColor &color) { m_tSettings.assign(m_tSettings.size(), color); }
    virtual void SetColors(const TLEDSettings &colors)
    {
        for (size_t i = 0; i < m_tSettings.size() && i < colors.size(); ++i)
            SetColor(i, colors[i]);
    }
    void VsUpdate(vs_robot *robot) override;
};

/* All LEDs of any robot: of an e-puck the ring of 8, which is red where a colour is not black, then
 * front left, front right and back. Where these three are dark they show the ring's first colour. Of
 * a foot-bot the ring of 12, which a robot's own shows as far as it can, then the beacon. */
class CCI_LEDsActuator : public VsLights
{
public:
    typedef TLEDSettings TSettings;

    CCI_LEDsActuator() : VsLights(11) {}
    static const char *VsNameOf(const std::string &element);
    bool VsBind(vs_robot *robot, const std::string &element, const char *name) override;
    size_t GetNumLEDs() const { return m_tSettings.size(); }
    virtual void SetSingleColor(UInt32 led, const CColor &color)
    {
        if (led < m_tSettings.size())
            m_tSettings[led] = color;
    }
    virtual void SetAllColors(const CColor &color) { m_tSettings.assign(m_tSettings.size(), color); }
    virtual void SetAllColors(const TSettings &colors)
    {
        for (size_t i = 0; i < m_tSettings.size() && i < colors.size(); ++i)
            m_tSettings[i] = colors[i];
    }
    virtual void SetSingleIntensity(UInt32 led, UInt8 intensity)
    {
        if (led < m_tSettings.size())
            m_tSettings[led].SetAlpha(intensity);
    }
    virtual void SetAllIntensities(UInt8 intensity)
    {
        for (CColor &color : m_tSettings)
            color.SetAlpha(intensity);
    }
    void VsUpdate(vs_robot *robot) override;
};

/* 0 is empty and 1 full; 1 where nobody tells. */
class VsBattery : public CCI_Sensor
{
public:
    VsBattery() : m_fBatteryLevel(1.0) {}
    bool VsBind(vs_robot *robot, const std::string &element, const char *name) override;
    void VsUpdate(vs_robot *robot) override;

protected:
    Real m_fBatteryLevel;
};

class CCI_EPuckBatterySensor : public VsBattery
{
public:
    static const char *VsNameOf(const std::string &element);
    Real GetBatteryLevel() { return m_fBatteryLevel; }
};

class CCI_BatterySensor : public VsBattery
{
public:
    struct SReading
    {
        Real AvailableCharge, TimeLeft;

        SReading() : AvailableCharge(1.0), TimeLeft(std::numeric_limits<Real>::infinity()) {}
    };

    static const char *VsNameOf(const std::string &element);
    const SReading &GetReading() const { return m_sReading; }
    void VsUpdate(vs_robot *robot) override
    {
        VsBattery::VsUpdate(robot);
        m_sReading.AvailableCharge = m_fBatteryLevel;
    }

protected:
    SReading m_sReading;
};

class CCI_PositioningSensor : public CCI_Sensor
{
public:
    struct SReading
    {
        CVector3 Position;
        CQuaternion Orientation;
    };

    static const char *VsNameOf(const std::string &element);
    const SReading &GetReading() const { return m_sReading; }
    void VsUpdate(vs_robot *robot) override;

protected:
    SReading m_sReading;
};

}  // namespace argos

#endif
