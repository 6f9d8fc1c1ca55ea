"""What is said of a camera's settings, from a scripted camera with its own ideas."""

from __future__ import annotations

from typing import Any

import pytest

from vsense.vision.cameras._genicam import apply
from vsense.vision.cameras.aravis import AravisError
from vsense.vision.cameras.source import Controls, GenicamSettings

OLD = {"ExposureTimeAbs": 100.0, "GainRaw": 3, "Width": 1024, "Height": 768, "OffsetX": 64,
       "OffsetY": 32, "PixelFormat": "Mono8", "TriggerSource": "Line0"}  # fmt: skip
NEW = {"ExposureTime": 100.0, "Gain": 3.0, "ExposureAuto": "Continuous", "GainAuto": "Off",
       "Width": 1024, "Height": 768, "OffsetX": 0, "OffsetY": 0, "PixelFormat": "BayerRG8",
       "BlackLevel": 1.5, "TriggerSource": "Line0"}  # fmt: skip
BOUNDS = {"ExposureTimeAbs": (10.0, 1e6), "ExposureTime": (19.0, 1e6), "GainRaw": (0, 10),
          "Gain": (0.0, 24.0), "Width": (16, 2048), "Height": (16, 2048)}  # fmt: skip


class Camera:
    """Holds features; refuses beyond bounds, words it does not know, and what is locked."""

    is_gige = True
    packet_size = 1500
    packet_delay_us = 0.0

    def __init__(self, features: dict[str, Any], formats: list[str], locked: str = "") -> None:
        self.features = dict(features)
        self._formats = formats
        self._locked = locked
        self.rate_hz = 5.0
        self.done: list[tuple[str, Any]] = []

    def has(self, name: str) -> bool:
        return name in self.features

    def get(self, name: str) -> str:
        return str(self.features[name])

    def set(self, name: str, text: str) -> None:
        low, high = BOUNDS.get(name, (-1e9, 1e9))
        old = self.features[name]
        if name == self._locked:
            raise AravisError(f"[{name}] is locked")
        if isinstance(old, str):
            if name == "PixelFormat" and text not in self._formats:
                raise AravisError(f"[{name}] '{text}' not an entry")
            self.features[name] = text
        elif not low <= float(text) <= high:
            raise AravisError(f"[{name}] '{text}' is out of range")
        else:
            # A camera that counts exposure in steps of 19 us.
            step = 19.0 if name == "ExposureTime" else 1.0
            value = float(text) // step * step
            self.features[name] = int(value) if isinstance(old, int) else value
        self.done.append((name, text))

    def bounds(self, name: str) -> tuple[float, float] | None:
        return BOUNDS.get(name)

    def formats(self) -> list[str]:
        return self._formats

    def set_rate(self, rate_hz: float) -> None:
        self.rate_hz = min(rate_hz, 15.0)
        self.done.append(("rate", rate_hz))

    def set_trigger(self, source: str | None) -> None:
        self.done.append(("trigger", source))
        self.features["TriggerSource"] = source

    def set_packets(self, size: int | None, delay_us: float | None) -> None:
        if delay_us is not None:
            raise AravisError("GevSCPD not found")
        self.packet_size = min(size or 1400, 8192)


def old(**more: Any) -> Camera:
    return Camera(OLD | more, ["Mono8", "BayerBG8"])


def wish(*controls: Any, **more: Any) -> GenicamSettings:
    return GenicamSettings(Controls(*controls), **more)


def test_what_is_taken_as_it_is_asked_for_is_not_worth_a_word() -> None:
    camera = old()
    assert apply(camera, wish((640, 480), 10.0, 8000.0, 7.0, offset_px=(16, 8))) == []  # type: ignore[arg-type]
    wanted = {"ExposureTimeAbs": 8000.0, "GainRaw": 7, "Width": 640, "Height": 480,
              "OffsetX": 16, "OffsetY": 8, "PixelFormat": "Mono8"}  # fmt: skip
    assert {name: camera.features[name] for name in wanted} == wanted
    assert camera.rate_hz == 10.0


def test_a_part_of_the_sensor_begins_at_the_left_before_it_is_made_wide() -> None:
    camera = old()
    apply(camera, wish((640, 480), offset_px=(16, 8)))  # type: ignore[arg-type]
    places = [name for name, _ in camera.done if name in OLD and name != "PixelFormat"]
    assert places == ["OffsetX", "OffsetY", "Width", "Height", "OffsetX", "OffsetY"]


def test_newer_names_are_found_automatics_end_and_rounding_is_said() -> None:
    camera = Camera(NEW, ["BayerRG8", "Mono12"])
    said = apply(camera, wish(None, 20.0, 8000.0, 25.0, features=(("BlackLevel", "2.0"),)))  # type: ignore[arg-type]
    assert said == [
        "takes 15 for frame_rate 20",
        "takes 7999 for exposure_time_abs 8000",
        "does not take gain_raw 25 (0 to 24): keeps 3",
    ]
    assert camera.features["ExposureAuto"] == "Off" and camera.features["BlackLevel"] == 2.0


@pytest.mark.parametrize(
    "wanted, said",
    [
        (wish(features=(("Gamma", "1"),)), ["has no Gamma"]),
        (wish(None, None, 5.0), ["does not take exposure_time_abs 5 (10 to 1000000): keeps 100"]),
        (
            wish(pixel_format="BayerRG8"),
            ["does not take pixel_format BayerRG8: keeps Mono8 ([PixelFormat] 'BayerRG8' not an"
             " entry)"],
        ),
        (wish(packet_size=9000), ["takes 8192 for packet_size 9000"]),
        (
            wish(packet_delay_us=5.0),
            ["does not take packet_size or packet_delay: GevSCPD not found"],
        ),
    ],
)  # fmt: skip
def test_what_a_camera_refuses_is_said_with_its_reason(
    wanted: GenicamSettings, said: list[str]
) -> None:
    assert apply(old(), wanted) == said  # type: ignore[arg-type]


def test_a_camera_without_exposure_and_gain_says_so() -> None:
    bare = {name: OLD[name] for name in ("Width", "Height", "PixelFormat", "TriggerSource")}
    camera = Camera(bare, ["Mono8"])
    said = apply(camera, wish(None, None, 8000.0, 3.0, offset_px=(0, 0)))  # type: ignore[arg-type]
    assert said == ["has no offset_x", "has no offset_y", "has no exposure_time_abs",
                    "has no gain_raw"]  # fmt: skip


def test_a_feature_that_is_locked_keeps_its_value_and_says_why() -> None:
    camera = Camera(OLD, ["Mono8"], locked="GainRaw")
    assert apply(camera, wish(None, None, None, 5.0)) == [  # type: ignore[arg-type]
        "does not take gain_raw 5: keeps 3 ([GainRaw] is locked)"
    ]


@pytest.mark.parametrize(
    "trigger, done", [("free", "rate"), ("software", "Software"), ("Line1", "Line1")]
)
def test_a_camera_runs_freely_or_is_triggered(trigger: str, done: str) -> None:
    camera = old()
    assert apply(camera, wish(None, 10.0, trigger=trigger)) == []  # type: ignore[arg-type]
    times = [each for each in camera.done if each[0] in ("rate", "trigger")]
    assert times == [("rate", 10.0) if trigger == "free" else ("trigger", done)]


def test_formats_of_more_than_a_byte_are_refused_with_those_that_serve() -> None:
    with pytest.raises(AravisError, match="Mono12, RGB8"):
        apply(Camera(OLD, ["Mono12", "RGB8"]), wish())  # type: ignore[arg-type]
