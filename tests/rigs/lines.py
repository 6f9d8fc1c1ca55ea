"""Lines between points, and the bodies that they meet, as the C library's kernels find them.

`skip` are rows of bodies that do not stand in the way, (n,) or (n, 2) or one for all lines. A
number that is not finite, or beyond what an arena can hold, raises WireError.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsense.base.native import check, kernel_ffi, kernels
from vsense.world.rays import Bodies

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

NOBODY = -1
"""In `skip`: the line passes through no body."""


def blocked(
    starts_m: ArrayLike, ends_m: ArrayLike, bodies: Bodies, skip: ArrayLike = NOBODY
) -> Bools:
    """Which lines (n, 3) to (n, 3) touch a body, also at the start or the end itself: (n,)."""
    lines, results = _lines(starts_m, ends_m, skip)
    result = kernel_ffi.from_buffer("uint8_t[]", results[0])
    check(kernels.vs_rays_blocked(bodies.cdata, *lines, result), "lines of sight")
    return results[0]


def nearest(
    starts_m: ArrayLike, ends_m: ArrayLike, bodies: Bodies, skip: ArrayLike = NOBODY
) -> Floats:
    """Share of each line up to the first body that it touches, in [0, 1]: (n,).

    It is 0 where the line starts in a body, inf where the line is free.
    """
    lines, results = _lines(starts_m, ends_m, skip)
    result = kernel_ffi.from_buffer("double[]", results[1])
    check(kernels.vs_rays_nearest(bodies.cdata, *lines, result), "lines of sight")
    return results[1]


def in_sight(
    points_m: ArrayLike, goals_m: ArrayLike, bodies: Bodies, skip: ArrayLike = NOBODY
) -> Bools:
    """Whether the lines from points (n, 3) to goals (k, 3) are free: (n, k)."""
    (points, _, count, skips, width), _ = _lines(points_m, points_m, skip)
    goals = np.ascontiguousarray(goals_m, dtype=np.float64).reshape(-1, 3)
    results = np.empty((count, len(goals)), dtype=np.bool_)
    given = kernel_ffi.from_buffer("double[]", goals)
    result = kernel_ffi.from_buffer("uint8_t[]", results)
    code = kernels.vs_sight_seen(
        bodies.cdata, points, count, given, len(goals), skips, width, result
    )
    check(code, "lines of sight")
    return results


def _lines(
    starts_m: ArrayLike, ends_m: ArrayLike, skip: ArrayLike
) -> tuple[tuple[Any, Any, int, Any, int], tuple[Bools, Floats]]:
    """Lines as the library takes them, and room for a result of each."""
    starts, ends = (
        np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
        for points in (starts_m, ends_m)
    )
    if len(starts) != len(ends):
        raise ValueError(f"{len(starts)} starts and {len(ends)} ends, expected as many")
    skips = np.asarray(skip, dtype=np.int32)
    width = skips.shape[1] if skips.ndim == 2 else 1
    skips = np.ascontiguousarray(np.broadcast_to(skips.reshape(-1, width), (len(starts), width)))
    begin, end = (kernel_ffi.from_buffer("double[]", points) for points in (starts, ends))
    given = kernel_ffi.from_buffer("int32_t[]", skips)
    results = np.empty(len(starts), dtype=np.bool_), np.empty(len(starts))
    return (begin, end, len(starts), given, width), results
