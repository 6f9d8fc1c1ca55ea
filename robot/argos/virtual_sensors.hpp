/* SPDX-License-Identifier: MIT */
/*
 * virtual_sensors.hpp - the virtual sensors of IRIDIA's system (Source: names and members of
 * github.com/demiurge-project/argos3-tycho at 066ccbc), served by ours.
 */
#ifndef VS_ARGOS_VIRTUAL_SENSORS_HPP
#define VS_ARGOS_VIRTUAL_SENSORS_HPP

#include "controller.hpp"

namespace argos {

class CVirtualSensorNetworkData
{
public:
    virtual ~CVirtualSensorNetworkData() {}
    virtual CByteArray Serialize() const = 0;
    virtual void Deserialize(CByteArray &buffer) = 0;
};

class CVirtualSensorDataPosition2D : public CVirtualSensorNetworkData
{
public:
    Real XRange, YRange, Bearing;

    CVirtualSensorDataPosition2D(Real x = 0.0, Real y = 0.0, Real bearing = 0.0)
        : XRange(x), YRange(y), Bearing(bearing)
    {
    }
    bool operator==(const CVirtualSensorDataPosition2D &other) const
    {
        return XRange == other.XRange && YRange == other.YRange && Bearing == other.Bearing;
    }
    bool operator!=(const CVirtualSensorDataPosition2D &other) const { return !(*this == other); }
    CByteArray Serialize() const override
    {
        CByteArray buffer;
        buffer << XRange << YRange << Bearing;
        return buffer;
    }
    void Deserialize(CByteArray &buffer) override { buffer >> XRange >> YRange >> Bearing; }
    virtual bool IsColliding(CVirtualSensorDataPosition2D other, Real radius) const
    {
        return Abs(other.XRange - XRange) < 2.0 * radius && Abs(other.YRange - YRange) < 2.0 * radius;
    }
};

/* Where something is: x, y and heading in the arena. */
class VsPoseSensor : public CCI_Sensor
{
public:
    VsPoseSensor() : m_unTimeTillUpdate(0) {}
    const CVirtualSensorDataPosition2D &GetReading() const { return m_cReading; }
    void VsUpdate(vs_robot *robot) override;

protected:
    CVirtualSensorDataPosition2D m_cReading;
    UInt32 m_unTimeTillUpdate; /* [control step] since the reading was measured */
};

class CCI_GPSVirtualSensor : public VsPoseSensor
{
public:
    static const char *VsNameOf(const std::string &element);
    UInt32 GetTickTimeTillLastUpdate() { return m_unTimeTillUpdate; }
};

class CCI_DestinationVirtualSensor : public VsPoseSensor
{
public:
    static const char *VsNameOf(const std::string &element);
};

class CCI_VirtualRGBGroundSensor : public CCI_Sensor
{
public:
    struct SReading
    {
        UInt8 R, G, B;

        SReading() : R(0), G(0), B(0) {}
    };

    static const char *VsNameOf(const std::string &element);
    const SReading &GetReading() const { return m_cReading; }
    void VsUpdate(vs_robot *robot) override;

protected:
    SReading m_cReading;
};

class CCI_VirtualRadiationSensor : public CCI_Sensor
{
public:
    struct SReading
    {
        Real Intensity;

        SReading() : Intensity(0.0) {}
    };

    static const char *VsNameOf(const std::string &element);
    const SReading &GetReading() const { return m_cReading; }
    void VsUpdate(vs_robot *robot) override;

protected:
    SReading m_cReading;
};

class CCI_VirtualPollutantSensor : public CCI_Sensor
{
public:
    struct SReading
    {
        Real Value;

        SReading() : Value(0.0) {}
    };

    static const char *VsNameOf(const std::string &element);
    const SReading &GetReading() const { return m_cReading; }
    void VsUpdate(vs_robot *robot) override;

protected:
    SReading m_cReading;
};

/* Unit vectors towards two places. */
class CCI_VirtualBlackWhiteLocationSensor : public CCI_Sensor
{
public:
    struct SReading
    {
        CVector2 vWhiteLocation, vBlackLocation;
    };

    static const char *VsNameOf(const std::string &element);
    const SReading &GetReading() const { return m_cReading; }
    void VsUpdate(vs_robot *robot) override;

protected:
    SReading m_cReading;
};

}  // namespace argos

#endif
