"""Threads that share pieces of work: which of them does a piece changes nothing."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from vsense.vision.tracking._kernel import MARKER
from vsense.vision.tracking._workers import Workers, _joined


@pytest.fixture
def two() -> Iterator[Workers]:
    made = Workers(2)
    yield made
    made.close()
    made.close()


@given(st.integers(1, 3), st.integers(0, 9))
def test_every_piece_is_done_once_and_given_in_its_order(number: int, pieces: int) -> None:
    workers, done = Workers(number), []

    def work(worker: int, piece: int) -> int:
        assert 0 <= worker < number
        done.append(piece)
        return 10 * piece

    assert workers.share(work, pieces) == [10 * piece for piece in range(pieces)]
    assert sorted(done) == list(range(pieces))
    workers.close()


def test_a_slow_piece_leaves_the_others_to_the_other_thread(two: Workers) -> None:
    others = threading.Barrier(2, timeout=20.0)
    left = iter(range(5))

    def work(worker: int, piece: int) -> int:
        if piece == 0 or next(left) == 4:
            others.wait()
        return worker

    slow, *rest = two.share(work, 6)
    assert rest == [1 - slow] * 5


def test_no_two_pieces_are_one_thread_s_at_once(two: Workers) -> None:
    """Each worker has kernels of its own, whose memory serves one picture at a time."""
    busy, lock = [0, 0], threading.Lock()

    def work(worker: int, _piece: int) -> int:
        with lock:
            busy[worker] += 1
            assert busy[worker] == 1
        threading.Event().wait(0.001)
        with lock:
            busy[worker] -= 1
        return worker

    assert len(two.share(work, 40)) == 40


def test_what_fails_in_a_thread_fails_for_whoever_asked(two: Workers) -> None:
    def work(worker: int, piece: int) -> int:
        if piece == 3:
            raise ValueError("the fourth")
        return piece

    with pytest.raises(ValueError, match="the fourth"):
        two.share(work, 6)
    assert two.share(lambda worker, piece: piece, 3) == [0, 1, 2]


def test_where_one_fails_the_others_have_ended_before_it_is_told(two: Workers) -> None:
    """Or the next timestep's would meet them in the same kernels."""
    begun, ended = threading.Event(), threading.Event()

    def work(worker: int, piece: int) -> None:
        if piece == 0:
            begun.wait(20.0)
            raise ValueError("the first")
        begun.set()
        threading.Event().wait(0.2)
        ended.set()

    with pytest.raises(ValueError, match="the first"):
        two.share(work, 2)
    assert ended.is_set()


def test_a_single_one_is_the_caller_s_thread_unless_it_is_pinned() -> None:
    here = threading.get_ident()
    assert Workers().share(lambda worker, piece: threading.get_ident(), 2) == [here, here]
    pinned = Workers(1, pin=True)
    (there, seen), *_ = pinned.share(
        lambda worker, piece: (threading.get_ident(), os.sched_getaffinity(0)), 1
    )
    pinned.close()
    assert there != here and len(seen) == 1
    assert seen <= os.sched_getaffinity(0)


def test_of_one_place_the_layer_that_reads_a_tag_counts_and_of_two_the_better() -> None:
    def layer(*markers: tuple[float, float, float]) -> NDArray[np.void]:
        rows = np.zeros(len(markers), dtype=MARKER)
        rows["x_m"], rows["tag"], rows["error"] = np.array(markers).reshape(-1, 3).T
        return rows

    # Tag 0 read badly, and the same marker not read in the other layer, with the lower error.
    one, other = layer((1.0, 0.0, 0.3), (3.0, 7.0, 0.2)), layer((1.0, -1.0, 0.1))
    better = layer((3.0, 8.0, 0.1), (5.0, -1.0, 0.4))
    joined = _joined([one, other, better])
    assert sorted(zip(joined["x_m"], joined["tag"])) == [(1.0, 0.0), (3.0, 8.0), (5.0, -1.0)]
