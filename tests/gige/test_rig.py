"""The test's own cameras are what they are taken for: looked at with our library and without."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from tests.gige.faults import VICTIM
from tests.gige.network import CAMERAS, RATE_HZ, SIZE_PX, GigeCameras
from tests.gige.watch import Watch
from vsense.base.clock import host_ns
from vsense.vision.cameras._aravis_camera import BUFFERS
from vsense.vision.cameras._genicam import GenicamSource
from vsense.vision.cameras.aravis import listed
from vsense.vision.cameras.source import Controls, GenicamSettings


def source(
    rig: GigeCameras, exposure_us: float, gain_raw: float, pixel_format: str | None = None
) -> GenicamSource:
    """The first camera."""
    controls = Controls(SIZE_PX, RATE_HZ, exposure_us, gain_raw)
    settings = GenicamSettings(controls, pixel_format=pixel_format)
    return GenicamSource(rig.address(0), settings, host_ns)


def picture(source: GenicamSource) -> np.ndarray:
    """A picture as the camera is set."""
    assert source.open() == []
    try:
        return source.read().image.astype(float)
    finally:
        source.close()


def test_all_four_answer_from_their_own_addresses(rig: GigeCameras) -> None:
    rig.start()
    mine = {rig.serial(n): rig.address(n) for n in range(len(CAMERAS))}
    found = [camera for camera in listed() if camera.serial in mine]
    assert {camera.serial: camera.address for camera in found} == mine and len(found) == len(mine)
    assert {(c.protocol, c.vendor, c.model) for c in found} == {("GigEVision", "Aravis", "Fake")}


def test_brightness_follows_exposure_and_gain(rig: GigeCameras) -> None:
    rig.start(0)
    scene = picture(source(rig, 8000, 0))
    assert scene.shape == SIZE_PX[::-1]
    half = picture(source(rig, 4000, 0))
    assert half.mean() == pytest.approx(0.5 * scene.mean(), rel=0.03)
    bayer = picture(source(rig, 4000, 6, "BayerRG8"))
    assert bayer.mean() == pytest.approx(scene.mean(), rel=0.03), "the world is grey"


def test_pictures_stay_as_they_are_however_many_are_kept(rig: GigeCameras) -> None:
    """A buffer that is lent is not filled again; where too many are lent a copy is given."""
    rig.start(0)
    camera = source(rig, 8000, 0)
    assert camera.open() == []
    try:
        kept = [
            (image, image.copy()) for image in (camera.read().image for _ in range(2 * BUFFERS))
        ]
        assert all(np.array_equal(image, before) for image, before in kept)
    finally:
        camera.close()
    assert all(np.array_equal(image, before) for image, before in kept)
    assert not any(np.array_equal(a, b) for (a, _), (b, _) in pairwise(kept)), "they have noise"
    lent = sum(not image.flags.owndata and image.base is not None for image, _ in kept)
    assert 0 < lent < len(kept)


def test_two_cameras_with_one_address_are_both_named(rig: GigeCameras, tmp_path: Path) -> None:
    rig.start(1, 2, 3)
    rig.same_address(VICTIM, 0)
    watch = Watch(rig, tmp_path)
    name, others = CAMERAS[VICTIM].id, [camera.id for camera in CAMERAS[2:]]
    try:
        watch.until(lambda: watch.told(name, "gone"), "word of it")
        event = watch.told(name, "gone")
        assert event is not None
        assert all(rig.serial(n) in event.text for n in (0, VICTIM))
        assert f"address {rig.address(VICTIM)}" in event.text
        watch.delivered(*others)
        rig.own_address(0)
        watch.all_deliver()
    finally:
        watch.close()
