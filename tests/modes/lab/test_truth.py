"""The truth ring and the truth log: what is read is what was written, whole or not at all."""

from __future__ import annotations

import subprocess
import sys
import uuid
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.rigs.places import ROOT
from vsense.base.arena import wrap_angle
from vsense.base.shared import LabError, SharedBlock
from vsense.modes.lab.truth import (
    TICKS,
    TruthLog,
    TruthReader,
    TruthWriter,
    make_ring,
    read_truth,
    truth_at,
    truth_dtype,
)

WRITER = """
import sys
import numpy as np
from vsense.modes.lab.truth import TruthWriter

writer = TruthWriter(sys.argv[1], 16)
time_ns = 0
print("writing", flush=True)
while time_ns < int(sys.argv[2]):
    time_ns += 1
    writer.write(time_ns, np.full((16, 3), time_ns % 3.0), np.full(16, time_ns % 60000))
"""

angles = st.floats(-np.pi, np.pi, exclude_min=True)
places = st.floats(-10.0, 10.0)
poses = st.tuples(places, places, angles)


def ring_of(bodies: int) -> tuple[SharedBlock, TruthWriter, TruthReader]:
    block = make_ring(bodies)
    return block, TruthWriter(block.name, bodies), TruthReader(block.name)


@given(before=poses, after=poses, share=st.floats(0.0, 1.0))
def test_truth_between_ticks_is_interpolated_on_the_short_way_round(before, after, share) -> None:
    _, writer, reader = ring_of(1)
    span = 10_000_000
    writer.write(span, np.array([before]), np.array([1]))
    writer.write(2 * span, np.array([after]), np.array([2]))
    moment = span + round(share * span)
    share = (moment - span) / span
    (x, y, yaw), leds = reader.at(moment)[0][0], reader.at(moment)[1]
    assert np.allclose((x, y), (1 - share) * np.array(before[:2]) + share * np.array(after[:2]))
    turn = wrap_angle(after[2] - before[2])
    assert -np.pi < yaw <= np.pi
    assert abs(wrap_angle(yaw - before[2] - share * turn)) < 1e-9
    assert leds[0] == (2 if moment == 2 * span else 1)


def test_every_tick_still_held_is_read_as_written() -> None:
    _, writer, reader = ring_of(3)
    assert reader.newest_ns() == 0
    ticks = TICKS + 40
    for k in range(1, ticks + 1):
        writer.write(10 * k, np.full((3, 3), k / 1000), np.full(3, k))
        assert reader.newest_ns() == 10 * k
    for k in range(ticks - TICKS + 1, ticks + 1):
        found, leds = reader.at(10 * k)
        assert np.allclose(found, k / 1000, atol=1e-12) and (leds == k).all()


@pytest.mark.parametrize("moment", [10 * 40 - 1, 10 * (TICKS + 40) + 1])
def test_moments_outside_of_the_ring_are_refused(moment: int) -> None:
    _, writer, reader = ring_of(1)
    for k in range(1, TICKS + 41):
        writer.write(10 * k, np.zeros((1, 3)), np.zeros(1, dtype=int))
    with pytest.raises(LabError, match=f"asked for {moment} ns, it holds 410 .. 2960"):
        reader.at(moment)


def test_an_empty_ring_says_so() -> None:
    _, _, reader = ring_of(1)
    with pytest.raises(LabError, match="nothing yet"):
        reader.at(1)


@given(written=st.integers(1, 471), seed=st.integers(0, 2**32 - 1))
def test_a_half_written_record_is_never_believed(written: int, seed: int) -> None:
    block, writer, reader = ring_of(16)
    rng = np.random.default_rng(seed)
    for k in range(1, TICKS + 2):
        writer.write(k, rng.normal(size=(16, 3)), rng.integers(0, 1024, 16))
    size = (len(block.bytes) - 16) // TICKS
    slot = block.bytes[16 + 2 * size : 16 + 3 * size]
    overwritten = slot.copy()
    writer.write(TICKS + 2, rng.normal(size=(16, 3)), rng.integers(0, 1024, 16))
    whole = slot.copy()
    slot[written:] = overwritten[written:]
    torn = bool((slot != whole).any())
    newest = TICKS + 1 if torn else TICKS + 2
    assert reader.newest_ns() == newest, "a writer that is held up holds up nobody"
    reader.at(newest)
    if torn:
        with pytest.raises(LabError, match=r"broken|it holds"):
            reader.at(TICKS + 2)
    slot[:] = whole
    reader.at(TICKS + 2)


def test_reading_while_another_process_writes_as_fast_as_it_can() -> None:
    block = make_ring(16)
    reader = TruthReader(block.name)
    ticks = 60_000
    command = [sys.executable, "-c", WRITER, block.name, str(ticks)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=ROOT) as writer:
        assert writer.stdout is not None and writer.stdout.readline() == b"writing\n"
        reads = 0
        while (newest := reader.newest_ns()) < ticks:
            try:
                found, leds = reader.at(newest)
            except LabError as error:
                assert "it holds" in str(error), "the writer is a whole ring ahead"
                continue
            assert (found[:, :2] == newest % 3.0).all(), "torn"
            assert (leds == newest % 60000).all(), "torn"
            reads += 1
        assert reads > 100


def test_a_plain_name_is_made_by_the_writer_and_removed_by_it() -> None:
    name = f"vsense-test-{uuid.uuid4().hex}"
    with pytest.raises(LabError, match="nobody has made it"):
        TruthReader(name)
    writer = TruthWriter(name, 2)
    reader = TruthReader(name)
    assert reader.bodies == 2
    reader.close()
    assert (Path("/dev/shm") / name).exists()
    writer.close()
    assert not (Path("/dev/shm") / name).exists()


def test_rings_of_another_kind_are_refused() -> None:
    ring = make_ring(3)
    with pytest.raises(LabError, match="made for 3 bodies, not 2"):
        TruthWriter(ring.name, 2)
    with pytest.raises(LabError, match="not a truth ring"):
        TruthReader(SharedBlock.anonymous("other", 64).name)
    ring.close()
    with pytest.raises(LabError, match="its maker is gone"):
        TruthReader(ring.name)


@given(seed=st.integers(0, 2**32 - 1), lost=st.integers(0, 100))
def test_truth_log_gives_back_every_whole_record(tmp_path_factory, seed: int, lost: int) -> None:
    path = tmp_path_factory.mktemp("log") / "truth.bin"
    rng = np.random.default_rng(seed)
    log = TruthLog(path, 4)
    rows = [
        (k, 10 * k, 10 * k + 3, k + 1, rng.normal(size=(4, 3)), rng.integers(0, 1024, 4))
        for k in range(5)
    ]
    for row in rows:
        log.append(*row)
    log.close()
    content = path.read_bytes()
    path.write_bytes(content[: len(content) - lost])
    read = read_truth(path)
    assert len(read) == (5 if lost == 0 else 4)
    for found, row in zip(read, rows):
        assert all(np.array_equal(a, b) for a, b in zip(found, row))


def test_of_later_runs_only_their_records_are_read_up_to_the_first_that_is_lacking(
    tmp_path: Path,
) -> None:
    path = tmp_path / "truth.bin"
    log = TruthLog(path, 2)
    for timestep in (0, 1, 2, 5, 6):
        log.append(timestep, 0, 0, 0, np.zeros((2, 3)), np.zeros(2, np.uint16))
    log.close()
    for number in range(5):
        before = 16 + number * truth_dtype(2).itemsize
        found = read_truth(path, before + 3)["timestep"].tolist()
        assert found == [0, 1, 2, 5, 6][number:]
    truth = read_truth(path)
    for wanted, there in (
        ([0, 2], [0, 2]), ([1, 2, 3, 5], [1, 2]), ([3, 5], []), ([5, 6, 7], [5, 6]), ([], []),
    ):  # fmt: skip
        assert truth_at(truth, np.array(wanted, np.int64))["timestep"].tolist() == there


def test_what_is_no_truth_log_is_refused(tmp_path: Path) -> None:
    other = tmp_path / "other.bin"
    other.write_bytes(b"something else altogether")
    with pytest.raises(LabError, match=r"other\.bin: begins with"):
        read_truth(other)
    with pytest.raises(LabError, match=r"none\.bin: No such file"):
        read_truth(tmp_path / "none.bin")
    with pytest.raises(LabError, match="Is a directory"):
        TruthLog(tmp_path, 1)
