"""The picture of a run: the arena at chosen moments, and below it the measures over time.

For the pollution experiment these are figures 5.1 and 5.2 of the thesis in one picture.
"""

from __future__ import annotations

from collections.abc import Sequence

from vsense.pictures import arena_view, chart
from vsense.pictures.arena_view import LIT, WIDTH_PX, ArenaMoment
from vsense.pictures.canvas import INK, MUTED, SCALE, Canvas, Image
from vsense.pictures.chart import Chart

MARGIN = 40
HEAD = 116
CAPTION = 96
FOOT = 64


def draw(
    heading: str, subtitle: str, scenes: Sequence[ArenaMoment], charts: Sequence[Chart]
) -> Image:
    """Draws the whole picture.

    Args:
        heading: what experiment this is.
        subtitle: how it was run.
        scenes: at least one moment, all of the same arena.
        charts: measures over time, side by side.

    Returns:
        (h, w, 3) BGR image.
    """
    panels = [arena_view.draw(scene) for scene in scenes]
    height = panels[0].shape[0] // SCALE
    width = MARGIN + (WIDTH_PX + MARGIN) * len(panels)
    chart_top = HEAD + height + CAPTION
    total = chart_top + (chart.HEIGHT_PX + FOOT if charts else 0)
    canvas = Canvas(width, total)
    canvas.text(heading, MARGIN, 50, INK, 1.0)
    canvas.text(subtitle, MARGIN, 78, MUTED, 0.52)
    for index, (scene, panel) in enumerate(zip(scenes, panels, strict=True)):
        left = MARGIN + (WIDTH_PX + MARGIN) * index
        canvas.place(panel, left, HEAD)
        canvas.text(scene.title, left, HEAD + height + 28, INK, 0.6)
        canvas.text(scene.note, left, HEAD + height + 52, LIT, 0.52)
    room = (width - MARGIN) / max(len(charts), 1)
    for index, curve in enumerate(charts):
        chart.draw(canvas, curve, MARGIN + room * index, chart_top, room - MARGIN)
    return canvas.finished()
