/* SPDX-License-Identifier: MIT */
#include "readings.h"

#include <cstdio>

#include <argos3/core/utility/configuration/argos_configuration.h>

template <typename Ring> static std::vector<Real> ValuesAndAngles(const Ring &readings)
{
    std::vector<Real> values;
    for (size_t i = 0; i < readings.size(); ++i)
        values.push_back(readings[i].Value);
    for (size_t i = 0; i < readings.size(); ++i)
        values.push_back(readings[i].Angle.GetValue());
    return values;
}

template <typename Blobs> static std::vector<Real> Seen(const Blobs &readings)
{
    std::vector<Real> values(1, static_cast<Real>(readings.Counter));
    for (size_t i = 0; i < readings.BlobList.size(); ++i) {
        values.push_back(readings.BlobList[i]->Distance);
        values.push_back(readings.BlobList[i]->Angle.GetValue());
        values.push_back(readings.BlobList[i]->Color.GetRed());
        values.push_back(readings.BlobList[i]->Color.GetBlue());
    }
    return values;
}

void CReadings::Init(TConfigurationNode &t_node)
{
    std::string strMissing, strFail;
    GetNodeAttribute(t_node, "file", m_strFile);
    GetNodeAttributeOrDefault(t_node, "fail_in_step", m_nFailing, -1);
    GetNodeAttributeOrDefault(t_node, "missing", strMissing, strMissing);
    GetNodeAttributeOrDefault(t_node, "fail", strFail, strFail);
    m_nSteps = 0;
    LOG << GetId() << " begins" << std::endl;
    if (strFail != "")
        THROW_ARGOSEXCEPTION("told to fail: " << strFail);
    if (strMissing != "")
        GetSensor<CCI_EPuckLightSensor>(strMissing);
    Write("unset", std::vector<Real>(m_chUnset, m_chUnset + sizeof m_chUnset));
    Write("random", std::vector<Real>(1, m_pcRNG->Uniform(CRange<Real>(0.0, 1.0))));
    if (NodeExists(t_node, "point")) {
        TConfigurationNodeIterator it("point");
        for (it = it.begin(&t_node); it != it.end(); ++it) {
            CVector2 cPlace;
            GetNodeAttribute(*it, "at", cPlace);
            Write("point", std::vector<Real>{cPlace.GetX(), cPlace.GetY()});
        }
    }
    if (HasSensor("epuck_omnidirectional_camera"))
        GetSensor<CCI_EPuckOmnidirectionalCameraSensor>("epuck_omnidirectional_camera")->Enable();
}

void CReadings::ControlStep()
{
    if (m_nSteps++ == m_nFailing)
        THROW_ARGOSEXCEPTION("told to fail in step " << m_nFailing);
    Sense();
    SenseAny();
    SensePiPuck();
    SenseVirtual();
    Act();
}

void CReadings::Destroy()
{
    Write("destroyed", std::vector<Real>(1, m_nSteps));
}

void CReadings::Write(const std::string &name, const std::vector<Real> &values)
{
    FILE *psFile = std::fopen((m_strFile + GetId()).c_str(), "a");
    std::fprintf(psFile, "%s", name.c_str());
    for (size_t i = 0; i < values.size(); ++i)
        std::fprintf(psFile, " %.9g", values[i]);
    std::fprintf(psFile, "\n");
    std::fclose(psFile);
}

void CReadings::Sense()
{
    if (auto *pc = Sensor<CCI_EPuckProximitySensor>("epuck_proximity"))
        Write("epuck_proximity", ValuesAndAngles(pc->GetReadings()));
    if (auto *pc = Sensor<CCI_EPuckLightSensor>("epuck_light"))
        Write("epuck_light", ValuesAndAngles(pc->GetReadings()));
    if (auto *pc = Sensor<CCI_EPuckGroundSensor>("epuck_ground")) {
        const CCI_EPuckGroundSensor::SReadings &s = pc->GetReadings();
        Write("epuck_ground", std::vector<Real>{s.Left, s.Center, s.Right});
    }
    if (auto *pc = Sensor<CCI_EPuckRangeAndBearingSensor>("epuck_range_and_bearing"))
        for (auto *packet : pc->GetPackets())
            Write("epuck_range_and_bearing",
                  std::vector<Real>{packet->Range, packet->Bearing.GetValue(),
                                    Real(packet->Data[0]), Real(packet->Data[3])});
    if (auto *pc = Sensor<CCI_EPuckOmnidirectionalCameraSensor>("epuck_omnidirectional_camera"))
        Write("epuck_omnidirectional_camera", Seen(pc->GetReadings()));
    if (auto *pc = Sensor<CCI_EPuckBatterySensor>("epuck_battery"))
        Write("epuck_battery", std::vector<Real>(1, pc->GetBatteryLevel()));
    if (auto *pc = Sensor<CCI_EPuckEncoderSensor>("epuck_encoder"))
        Write("epuck_encoder", std::vector<Real>{pc->GetReading().CoveredDistanceLeftWheel,
                                                 pc->GetReading().CoveredDistanceRightWheel});
}

void CReadings::SenseAny()
{
    if (auto *pc = Sensor<CCI_ProximitySensor>("proximity"))
        Write("proximity", pc->GetReadings());
    if (auto *pc = Sensor<CCI_LightSensor>("light"))
        Write("light", pc->GetReadings());
    if (auto *pc = Sensor<CCI_GroundSensor>("ground"))
        Write("ground", pc->GetReadings());
    if (auto *pc = Sensor<CCI_FootBotProximitySensor>("footbot_proximity"))
        Write("footbot_proximity", ValuesAndAngles(pc->GetReadings()));
    if (auto *pc = Sensor<CCI_FootBotLightSensor>("footbot_light"))
        Write("footbot_light", ValuesAndAngles(pc->GetReadings()));
    if (auto *pc = Sensor<CCI_FootBotMotorGroundSensor>("footbot_motor_ground"))
        for (const auto &reading : pc->GetReadings())
            Write("footbot_motor_ground", std::vector<Real>{reading.Value, reading.Offset.GetX()});
    if (auto *pc = Sensor<CCI_FootBotBaseGroundSensor>("footbot_base_ground"))
        for (const auto &reading : pc->GetReadings())
            Write("footbot_base_ground", std::vector<Real>{reading.Value, reading.Offset.GetX()});
    if (auto *pc = Sensor<CCI_FootBotEncoderSensor>("footbot_encoder"))
        Write("footbot_encoder", std::vector<Real>{pc->GetReading().CoveredDistanceLeftWheel,
                                                   pc->GetReading().WheelAxisLength});
    if (auto *pc = Sensor<CCI_RangeAndBearingSensor>("range_and_bearing"))
        for (const auto &packet : pc->GetReadings())
            Write("range_and_bearing",
                  std::vector<Real>{packet.Range, packet.HorizontalBearing.GetValue(),
                                    Real(packet.Data.Size()), Real(packet.Data[0])});
    if (auto *pc = Sensor<CCI_BatterySensor>("battery"))
        Write("battery", std::vector<Real>(1, pc->GetReading().AvailableCharge));
    if (auto *pc = Sensor<CCI_DifferentialSteeringSensor>("differential_steering"))
        Write("differential_steering", std::vector<Real>{pc->GetReading().VelocityLeftWheel,
                                                         pc->GetReading().WheelAxisLength});
    if (auto *pc = Sensor<CCI_PositioningSensor>("positioning")) {
        CRadians cZ, cY, cX;
        pc->GetReading().Orientation.ToEulerAngles(cZ, cY, cX);
        Write("positioning", std::vector<Real>{pc->GetReading().Position.GetX(),
                                               pc->GetReading().Position.GetY(), cZ.GetValue()});
    }
}

void CReadings::SensePiPuck()
{
    if (auto *pc = Sensor<CCI_PiPuckRangefindersSensor>("pipuck_rangefinders"))
        pc->Visit([this](const CCI_PiPuckRangefindersSensor::SInterface &s) {
            CVector3 cAhead = CVector3::Z * std::get<Real>(s.Configuration);
            cAhead.Rotate(std::get<CQuaternion>(s.Configuration));
            Write("pipuck_rangefinders", std::vector<Real>{Real(s.Label), s.Proximity,
                                                           cAhead.GetX(), cAhead.GetY()});
        });
    if (auto *pc = Sensor<CCI_PiPuckGroundSensor>("pipuck_ground"))
        pc->Visit([this](const CCI_PiPuckGroundSensor::SInterface &s) {
            Write("pipuck_ground", std::vector<Real>{Real(s.Label), s.Reflected});
        });
    if (auto *pc = Sensor<CCI_PiPuckDifferentialDriveSensor>("pipuck_differential_drive"))
        Write("pipuck_differential_drive",
              std::vector<Real>{pc->GetLeftVelocity(), pc->GetRightVelocity()});
    if (auto *pc = Actuator<CCI_PiPuckDifferentialDriveActuator>("pipuck_differential_drive"))
        pc->SetLinearVelocity(0.05, -0.025);
    if (auto *pc = Actuator<CCI_PiPuckLEDsActuator>("pipuck_leds")) {
        pc->SetRingLEDIndex(1, true);
        pc->SetBodyLED(true);
    }
}

void CReadings::SenseVirtual()
{
    if (auto *pc = Sensor<CCI_GPSVirtualSensor>("gps_virtual_sensor"))
        Write("gps_virtual_sensor", std::vector<Real>{pc->GetReading().XRange,
                                                      pc->GetReading().YRange,
                                                      pc->GetReading().Bearing});
    if (auto *pc = Sensor<CCI_DestinationVirtualSensor>("destination_virtual_sensor"))
        Write("destination_virtual_sensor", std::vector<Real>{pc->GetReading().XRange});
    if (auto *pc = Sensor<CCI_VirtualRGBGroundSensor>("virtual_rgb_ground_sensor"))
        Write("virtual_rgb_ground_sensor",
              std::vector<Real>{Real(pc->GetReading().R), Real(pc->GetReading().G),
                                Real(pc->GetReading().B)});
    if (auto *pc = Sensor<CCI_VirtualRadiationSensor>("virtual_radiation_sensor"))
        Write("virtual_radiation_sensor", std::vector<Real>{pc->GetReading().Intensity});
    if (auto *pc = Sensor<CCI_VirtualPollutantSensor>("virtual_pollutant_sensor"))
        Write("virtual_pollutant_sensor", std::vector<Real>{pc->GetReading().Value});
    if (auto *pc = Sensor<CCI_VirtualBlackWhiteLocationSensor>("virtual_black_white_location_sensor"))
        Write("virtual_black_white_location_sensor",
              std::vector<Real>{pc->GetReading().vBlackLocation.GetX(),
                                pc->GetReading().vWhiteLocation.GetY()});
    if (auto *pc = Sensor<CCI_LightSensor>("virtual_light_sensor"))
        Write("virtual_light_sensor", pc->GetReadings());
    if (auto *pc = Sensor<CCI_GroundSensor>("virtual_ground_sensor"))
        Write("virtual_ground_sensor", pc->GetReadings());
}

void CReadings::Act()
{
    if (auto *pc = Actuator<CCI_EPuckWheelsActuator>("epuck_wheels"))
        pc->SetLinearVelocity(5.0, -2.5);
    if (auto *pc = Actuator<CCI_DifferentialSteeringActuator>("differential_steering"))
        pc->SetLinearVelocity(100.0, 1.0);
    if (auto *pc = Actuator<CCI_EPuckBaseLEDsActuator>("epuck_base_leds")) {
        pc->SwitchLED(0, true);
        pc->SwitchLED(2, true);
    }
    if (auto *pc = Actuator<CCI_EPuckRGBLEDsActuator>("epuck_rgb_leds")) {
        pc->SetColors(CColor::GREEN);
        pc->SetColor(2, CColor(1, 2, 3));
    }
    if (auto *pc = Actuator<CCI_LEDsActuator>("leds")) {
        pc->SetSingleColor(1, CColor::BLUE);
        pc->SetSingleColor(pc->GetNumLEDs() - 1, CColor::RED);
    }
    if (auto *pc = Actuator<CCI_EPuckRangeAndBearingActuator>("epuck_range_and_bearing")) {
        UInt8 punData[4] = {9, 8, 7, 255};
        pc->SetData(punData);
    }
    if (auto *pc = Actuator<CCI_RangeAndBearingActuator>("range_and_bearing"))
        pc->SetData(1, 77);
}

/* The same library holds another one. */
class COther : public CReadings
{
public:
    virtual void ControlStep() { Write("other", std::vector<Real>()); }
};

REGISTER_CONTROLLER(CReadings, "readings_controller")
REGISTER_CONTROLLER(COther, "other_controller");
