"""The hard sets: so many of all families' markers are named, and none wrong.

`NAMED` is what is reached now in exactly these pictures; two markers less may be chance. Before
arrows were looked for again where black is thin or light shines, and their light was fitted, 32 and
55 % of the small arrows of both kinds were named in the blur, 42 and 37 % in the glare, and none
where contrast is low; 37 and 38 % of the usual ones in the glare; and a name was wrong.
"""

from __future__ import annotations

import pytest

from tests.vision.tracking.hard_sets import FAMILIES, SCALES_PX_PER_M, SETS, score

PICTURES, CHANCE = 2, 3
NAMED = {
    "small": {
        "easy": (40, 40, 40, 40),
        "blur 1.2 px": (40, 21, 40, 38),
        "noise 6": (40, 40, 40, 39),
        "noise 12": (40, 35, 40, 39),
        "glare": (37, 20, 35, 22),
        "dark": (40, 39, 40, 39),
        "uneven": (40, 38, 40, 39),
        "low contrast": (40, 36, 40, 38),
        "very hard": (15, 1, 27, 26),
    },
    "usual": {
        "blur 1.2 px": (40, 40, 40, 40),
        "noise 12": (40, 40, 40, 40),
        "glare": (39, 37, 40, 40),
        "low contrast": (40, 40, 40, 40),
        "very hard": (40, 30, 40, 40),
    },
}
"""Of 40 markers of each of `FAMILIES`."""
QUICK = {("small", "blur 1.2 px"), ("small", "glare"), ("usual", "low contrast")}
CASES = [
    pytest.param(scale, title, marks=[] if (scale, title) in QUICK else [pytest.mark.campaign])
    for scale, sets in NAMED.items()
    for title in sets
]


@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize(("scale", "title"), CASES)
def test_so_many_are_named_and_none_wrong(scale: str, title: str, name: str) -> None:
    found = score(name, SCALES_PX_PER_M[scale], SETS[title], PICTURES)
    assert found.wrong == 0
    assert found.named >= NAMED[scale][title][FAMILIES.index(name)] - CHANCE


def test_cells_of_two_pixels_bear_blur_and_glare() -> None:
    """In the blur of 1.2 px, and under spots of light, nine of ten are named."""
    small, usual = SCALES_PX_PER_M.values()
    for title in ("blur 1.2 px", "glare"):
        for name, px_per_m in (("arrow4x4", small), ("arrow4x4-thesis", usual)):
            found = score(name, px_per_m, SETS[title], 2 * PICTURES)
            assert found.wrong == 0 and found.named >= 0.9 * found.markers
