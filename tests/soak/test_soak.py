"""What the soak calls a leak."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("aiohttp")

from tests.soak.soak import Sample, Soak

HOUR_S = 3600
NOISE = np.random.default_rng(1)


@pytest.mark.quick
@pytest.mark.parametrize(
    ("kib_at", "leaks"),
    [
        (lambda s: 1e5 + NOISE.normal(0.0, 500.0), False),
        (lambda s: 1e5 + s % 300 * 10, False),
        (lambda s: 1e5 + 20_000 * (s > 2000), False),
        (lambda s: 1e5 + 24 * s / 60, False),
        (lambda s: 1e5 + 44 * s / 60 + NOISE.normal(0.0, 500.0), False),
        (lambda s: 1e5 + 96 * s / 60 + NOISE.normal(0.0, 500.0), True),
        (lambda s: 1e5 + 5000 * (s // 600), True),
    ],
)
def test_what_leaks(kib_at: Callable[[float], float], leaks: bool) -> None:
    soak = Soak(HOUR_S)
    soak.kinds["host"] = [Sample(s, 1, kib_at(s), 9, 9) for s in range(0, HOUR_S, 5)]
    soak.table()
    assert bool(soak.broken) == leaks, soak.broken
