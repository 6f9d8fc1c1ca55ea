/* SPDX-License-Identifier: MIT */
/*
 * neighbours.hpp - what robots see and hear of each other: range and bearing, and the
 * omnidirectional camera; of the e-puck and of any robot. Distances are in cm.
 */
#ifndef VS_ARGOS_NEIGHBOURS_HPP
#define VS_ARGOS_NEIGHBOURS_HPP

#include "controller.hpp"

namespace argos {

/* A sensor whose reading is a count, and for each place so many numbers. */
class VsPlaces : public CCI_Sensor
{
protected:
    /* The numbers of all places in use, one place after the other. */
    std::vector<Real> Read(vs_robot *robot, size_t numbers) const;
};

/* Those who hear messages; the host says how many bytes a message has. */
class VsHearing : public VsPlaces
{
public:
    VsHearing() : m_bytes(4), m_two_radii_cm(7.0) {}
    bool VsBind(vs_robot *robot, const std::string &element, const char *name) override;

protected:
    size_t m_bytes;
    Real m_two_radii_cm; /* a range is without them */
};

class CCI_EPuckRangeAndBearingSensor : public VsHearing
{
public:
    static const UInt32 MAX_BYTES_RECEIVED = 4;
    typedef UInt8 TData[MAX_BYTES_RECEIVED];

    struct SReceivedPacket
    {
        Real Range;
        CRadians Bearing;
        TData Data;

        SReceivedPacket() : Range(0.0), Data() {}
        friend std::ostream &operator<<(std::ostream &out, const SReceivedPacket &packet)
        {
            out << "range = " << packet.Range << ", bearing = " << packet.Bearing << ", data =";
            for (const UInt8 byte : packet.Data)
                out << " " << byte;
            return out;
        }
    };
    typedef std::vector<SReceivedPacket *> TPackets;

    ~CCI_EPuckRangeAndBearingSensor() override { ClearPackets(); }
    static const char *VsNameOf(const std::string &element);
    void ClearPackets();
    const TPackets &GetPackets() const { return m_tPackets; }
    void Reset() override { ClearPackets(); }
    void VsUpdate(vs_robot *robot) override;

protected:
    TPackets m_tPackets;
};

class CCI_RangeAndBearingSensor : public VsHearing
{
public:
    struct SPacket
    {
        Real Range;
        CRadians HorizontalBearing, VerticalBearing;
        CByteArray Data;

        SPacket() : Range(0.0) {}
    };
    typedef std::vector<SPacket> TReadings;

    static const char *VsNameOf(const std::string &element);
    const TReadings &GetReadings() const { return m_tReadings; }
    void Reset() override { m_tReadings.clear(); }
    void VsUpdate(vs_robot *robot) override;

protected:
    TReadings m_tReadings;
};

/* Those who say something. */
class VsSaying : public CCI_Actuator
{
public:
    bool VsBind(vs_robot *robot, const std::string &element, const char *name) override;

protected:
    void Say(vs_robot *robot, const UInt8 *bytes, size_t count) const;
};

class CCI_EPuckRangeAndBearingActuator : public VsSaying
{
public:
    static const UInt32 MAX_BYTES_SENT = 4;
    typedef UInt8 TData[MAX_BYTES_SENT];

    enum EEmitterState {
        STATE_ALL_EMITTERS_DISABLED = 0,
        STATE_ALL_EMITTERS_SAME_DATA,
        STATE_EMITTERS_DIFFERENT
    };
    struct SEmitter
    {
        bool Enabled;
        TData Data;
    };
    struct SDataToSend
    {
        EEmitterState State;
        SEmitter Emitter[12];

        SDataToSend() : State(STATE_ALL_EMITTERS_DISABLED), Emitter() {}
    };

    static const char *VsNameOf(const std::string &element);
    virtual void SetData(const TData data);
    /* A robot here says the same in all directions: what the first enabled emitter says. */
    virtual void SetDataForEmitter(size_t emitter, const TData data);
    virtual void DisableEmitter(size_t emitter);
    void Disable() override;
    void Reset() override { Disable(); }
    void VsUpdate(vs_robot *robot) override;

protected:
    SDataToSend m_sDesiredData;
};

class CCI_RangeAndBearingActuator : public VsSaying
{
public:
    static const char *VsNameOf(const std::string &element);
    bool VsBind(vs_robot *robot, const std::string &element, const char *name) override;
    size_t GetSize() const { return m_cData.Size(); }
    void SetData(const CByteArray &data);
    void SetData(size_t i, UInt8 value) { m_cData[i] = value; }
    void ClearData() { m_cData.Zero(); }
    void Reset() override { ClearData(); }
    void VsUpdate(vs_robot *robot) override;

protected:
    CByteArray m_cData;
};

/* Messages by the infrared ring, which these robots have not: nobody offers them, and who asks for
 * them is told so. */
class CCI_EPuckIRComSensor : public VsPlaces
{
public:
    struct SPacket
    {
        UInt8 Data;
        UInt16 Sensor;
        Real Range;
        CRadians Bearing;

        SPacket() : Data(0), Sensor(0), Range(0.0) {}
    };
    typedef std::vector<SPacket *> TPackets;

    static const char *VsNameOf(const std::string &element);
    void ClearPackets() {}
    const TPackets &GetPackets() const { return m_tPackets; }
    void VsUpdate(vs_robot *) override {}

protected:
    TPackets m_tPackets;
};

class CCI_EPuckIRComActuator : public VsSaying
{
public:
    static const char *VsNameOf(const std::string &element);
    virtual void SetData(UInt8) {}
    virtual void SetEnabled(bool) {}
    void VsUpdate(vs_robot *) override {}
};

/* What a camera sees: one list that its sensor owns. Off until Enable, as in ARGoS. */
template <typename Blob> class VsCamera : public VsPlaces
{
public:
    typedef Blob SBlob;
    typedef std::vector<SBlob *> TBlobList;
    struct SReadings
    {
        TBlobList BlobList;
        UInt64 Counter;

        SReadings() : Counter(0) {}
        friend std::ostream &operator<<(std::ostream &out, const SReadings &readings)
        {
            out << "Counter: " << readings.Counter << std::endl;
            for (const SBlob *blob : readings.BlobList)
                out << *blob << std::endl;
            return out;
        }
    };

    VsCamera() { this->m_enabled = false; }
    ~VsCamera() override { Clear(); }
    const SReadings &GetReadings() const { return m_sReadings; }
    bool Enabled() const { return this->m_enabled; }

    void VsUpdate(vs_robot *robot) override
    {
        const std::vector<Real> seen = Read(robot, 5);
        ++m_sReadings.Counter;
        Clear();
        for (size_t i = 0; i + 5 <= seen.size(); i += 5)
            m_sReadings.BlobList.push_back(new SBlob(
                CColor(static_cast<UInt8>(seen[i + 2]), static_cast<UInt8>(seen[i + 3]),
                       static_cast<UInt8>(seen[i + 4])),
                CRadians(seen[i + 1]), seen[i]));
    }

protected:
    void Clear()
    {
        for (SBlob *blob : m_sReadings.BlobList)
            delete blob;
        m_sReadings.BlobList.clear();
    }

    SReadings m_sReadings;
};

struct VsBlob
{
    CColor Color;
    CRadians Angle;
    Real Distance;

    VsBlob() : Color(CColor::BLACK), Distance(0.0) {}
    VsBlob(const CColor &color, const CRadians &angle, Real distance)
        : Color(color), Angle(angle), Distance(distance)
    {
    }
    friend std::ostream &operator<<(std::ostream &out, const VsBlob &blob)
    {
        return out << "(Color = " << blob.Color << ",Angle = " << ToDegrees(blob.Angle)
                   << ",Distance = " << blob.Distance << ")";
    }
};

struct VsEPuckBlob : VsBlob
{
    UInt32 Area; /* as argos3-epuck measured it, 95.644 exp(-0.11 Distance) */

    VsEPuckBlob() : Area(0) {}
    VsEPuckBlob(const CColor &color, const CRadians &angle, Real distance)
        : VsBlob(color, angle, distance),
          Area(static_cast<UInt32>(95.644 * std::exp(static_cast<Real>(-0.11f) * distance)))
    {
    }
    VsEPuckBlob(const CColor &color, const CRadians &angle, Real distance, UInt32 area)
        : VsBlob(color, angle, distance), Area(area)
    {
    }
};

class CCI_EPuckOmnidirectionalCameraSensor : public VsCamera<VsEPuckBlob>
{
public:
    static const char *VsNameOf(const std::string &element);
};

class CCI_ColoredBlobOmnidirectionalCameraSensor : public VsCamera<VsBlob>
{
public:
    static const char *VsNameOf(const std::string &element);
};

}  // namespace argos

#endif
