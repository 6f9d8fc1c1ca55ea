"""Exposure and gain are asked, turned and put back; the cameras are scripted."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import pytest

from vsense.base.errors import GrabberError
from vsense.vision.cameras._v4l2 import V4l2Control, V4l2ControlDevice
from vsense.vision.cameras.aravis import AravisError
from vsense.vision.cameras.source import EXPOSURE, GAIN
from vsense.vision.tracking.single_camera import GenicamControls, V4l2Controls

NEW = {"ExposureAuto": "Continuous", "ExposureTime": "8000.5", "GainAuto": "Off", "Gain": "2"}
OLD = {"ExposureTimeAbs": "8000", "GainRaw": "12"}


class Genicam:
    """Features as text; while a camera sets one by itself nobody else can.

    Attributes:
        silent: whether it answers nobody.
        obeys: whether anything can be set.
    """

    silent, obeys = False, True

    def __init__(self, features: dict[str, str]) -> None:
        self.features = dict(features)
        self.order: list[str] = []
        self.asked = 0

    def has(self, name: str) -> bool:
        return name in self.features

    def get(self, name: str) -> str:
        self.asked += 1
        if self.silent:
            raise AravisError("timeout")
        return self.features[name]

    def set(self, name: str, value: str) -> None:
        self.asked += 1
        if self.silent:
            raise AravisError("timeout")
        if not self.obeys:
            raise AravisError("access denied")
        if name == "ExposureTime" and self.features["ExposureAuto"] != "Off":
            raise AravisError("is set by the camera itself")
        self.order.append(name)
        self.features[name] = value

    def bounds(self, name: str) -> tuple[float, float] | None:
        return 10.0, 1e6


def controls(camera: Any) -> GenicamControls:
    return GenicamControls(lambda: camera)


@pytest.mark.parametrize("features", [OLD, NEW])
def test_old_and_new_names_are_one_control(features: dict[str, str]) -> None:
    made = controls(Genicam(features))
    assert made.value(EXPOSURE) == pytest.approx(8000.0, abs=1.0)
    assert made.bounds(EXPOSURE) == (10.0, 1e6)
    made.set(EXPOSURE, 5000.0)
    made.set(GAIN, 1.0)
    assert made.value(EXPOSURE) == 5000.0 and made.value(GAIN) == 1.0


def test_what_the_camera_does_by_itself_is_off_while_it_is_turned_and_on_again() -> None:
    camera = Genicam(NEW)
    made = controls(camera)
    put_back = made.remember()
    made.set(EXPOSURE, 5000.0)
    assert camera.features["ExposureAuto"] == "Off"
    put_back()
    assert camera.features == NEW
    assert camera.order[-2:] == ["ExposureAuto", "GainAuto"], "last, else nothing could be set"


def test_a_camera_that_is_gone_or_has_none() -> None:
    gone = controls(None)
    assert gone.value(EXPOSURE) is None and gone.bounds(GAIN) is None
    with pytest.raises(GrabberError):
        gone.set(EXPOSURE, 1.0)
    bare = controls(Genicam({}))
    assert bare.value(GAIN) is None
    with pytest.raises(GrabberError, match="has no gain_raw"):
        bare.set(GAIN, 1.0)


def test_values_cannot_be_put_back_into_a_camera_that_is_gone() -> None:
    there: list[Any] = [Genicam(OLD)]
    made = GenicamControls(lambda: there[0])
    put_back = made.remember()
    there[0] = None
    with pytest.raises(GrabberError, match="is gone"):
        put_back()


def test_a_camera_that_is_silent_is_asked_about_one_setting_only() -> None:
    camera = Genicam(OLD)
    made = controls(camera)
    put_back = made.remember()
    made.set(EXPOSURE, 5000.0)
    camera.silent, camera.asked = True, 0
    with pytest.raises(GrabberError, match="exposure_time_abs: timeout"):
        put_back()
    assert camera.asked == 2, "each question to a silent camera takes seconds"


def test_what_a_camera_does_not_take_back_is_told() -> None:
    camera = Genicam(OLD)
    made = controls(camera)
    put_back = made.remember()
    made.set(GAIN, 3.0)
    camera.obeys = False
    with pytest.raises(GrabberError, match=r"gain_raw.*3.*12.*\(access denied\)"):
        put_back()


def test_what_a_camera_sets_by_itself_need_not_be_as_it_was() -> None:
    camera = Genicam(NEW)
    put_back = controls(camera).remember()
    camera.features["ExposureTime"] = "7000"
    put_back()
    assert camera.features == {**NEW, "ExposureTime": "7000"}


class Driver:
    """A V4L2 driver's controls, behind its ioctls."""

    refuses = False

    def __init__(self, values: dict[int, int]) -> None:
        self.values = dict(values)

    def __call__(self, file: int, request: int, data: bytes) -> bytes:
        (control,) = struct.unpack_from("I", data)
        if control not in self.values:
            raise OSError(22, "Invalid argument")
        if request & 0xFF == 36:
            return struct.pack("II32siiiiI8x", control, 1, b"name", 3, 2047, 1, 250, 0)
        if request & 0xFF == 28:
            value = struct.unpack("Ii", data)[1]
            if value > 2047 or self.refuses:
                raise OSError(34, "Numerical result out of range")
            self.values[control] = value
        return struct.pack("Ii", control, self.values[control])


WEBCAM = {V4l2Control.EXPOSURE: 250, V4l2Control.EXPOSURE_AUTO: 3, V4l2Control.GAIN: 64}


@pytest.fixture
def node(tmp_path: Path) -> str:
    (tmp_path / "video0").touch()
    return str(tmp_path / "video0")


def test_v4l2_counts_in_100_us(node: str) -> None:
    driver = Driver(WEBCAM)
    made = V4l2Controls(V4l2ControlDevice(node, driver))
    assert made.value(EXPOSURE) == 25_000.0 and made.value(GAIN) == 64.0
    assert made.bounds(EXPOSURE) == (300.0, 204_700.0) and made.bounds(GAIN) == (3.0, 2047.0)
    put_back = made.remember()
    made.set(EXPOSURE, 5000.0)
    assert (
        driver.values[V4l2Control.EXPOSURE] == 50 and driver.values[V4l2Control.EXPOSURE_AUTO] == 1
    )
    with pytest.raises(GrabberError, match="gain_raw 5000"):
        made.set(GAIN, 5000.0)
    put_back()
    assert driver.values == WEBCAM


def test_a_v4l2_device_that_has_another_value_or_is_gone(node: str) -> None:
    driver = Driver({V4l2Control.EXPOSURE: 250, V4l2Control.EXPOSURE_AUTO: 1})
    put_back = V4l2Controls(V4l2ControlDevice(node, driver)).remember()
    driver.refuses = True
    driver.values[V4l2Control.EXPOSURE] = 50
    with pytest.raises(GrabberError, match=r"exposure_time_abs.*5000.*25000"):
        put_back()
    driver.values.clear()
    with pytest.raises(GrabberError, match=r"exposure_time_abs:.*answer"):
        put_back()


def test_a_device_without_controls(node: str) -> None:
    made = V4l2Controls(V4l2ControlDevice(node, Driver({})))
    assert made.value(EXPOSURE) is None and made.bounds(EXPOSURE) is None
    with pytest.raises(GrabberError):
        made.set(EXPOSURE, 5000.0)


def test_a_real_file_is_no_device(node: str) -> None:
    device = V4l2ControlDevice(node)
    assert device.get(V4l2Control.GAIN) is None and not device.set(V4l2Control.GAIN, 1)
