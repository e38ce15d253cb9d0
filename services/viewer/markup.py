"""The parts of the page that are HTML: the camera grid, the timeline, and lines of text."""

import base64
import html
from collections.abc import Sequence

import numpy as np

from services.mocap.verdict.verdict import Level, Verdict
from services.viewer.frame_history import Overview
from services.viewer.tiles import Tile

_TIMELINE_HEIGHT = 40
_KNOWN, _CURVE, _MARK, _CURSOR = "#d9e2ec", "#486581", "#d64545", "#102a43"
_LEVELS: dict[Level, tuple[str, str, str]] = {
    "good": ("#0b4821", "#dafbe1", "#1a7f37"),
    "usable with gaps": ("#4d2d00", "#fff8c5", "#bf8700"),
    "not usable": ("#82071e", "#ffebe9", "#cf222e"),
}
"""Colours of text, ground and edge."""
_CAPTION = (
    "position:absolute;left:5px;top:3px;color:white;font:600 12px system-ui,sans-serif;"
    "text-shadow:0 0 3px black,0 0 2px black"
)


def grid_columns(n_cameras: int, square: bool) -> int:
    """The number of columns for a number of tiles; square: tiles are as high as wide."""
    if n_cameras < 2:
        return 1
    return 2 if n_cameras <= (6 if square else 10) else 3


def camera_grid(tiles: Sequence[Tile], names: Sequence[str], frame: int, square: bool = False) -> str:
    """The tiles with their cameras' names and differing pixels; each image tells its frame."""
    cells = []
    for tile in tiles:
        source = base64.b64encode(tile.jpeg).decode()
        caption = html.escape(names[tile.camera])
        if tile.differing_px is not None:
            caption += f" · {tile.differing_px} px"
        if not tile.is_known:
            caption += " · no picture of this frame"
        cells.append(
            f'<div style="position:relative"><img alt="{html.escape(names[tile.camera])}" '
            f'data-frame="{frame}" style="width:100%;display:block" src="data:image/jpeg;base64,{source}">'
            f'<span style="{_CAPTION}">{caption}</span></div>'
        )
    columns = grid_columns(len(tiles), square)
    style = f"display:grid;grid-template-columns:repeat({columns},1fr);gap:3px;background:#111;padding:3px"
    return f'<div id="cameras" style="{style}">{"".join(cells)}</div>'


def timeline(overview: Overview, at: float) -> str:
    """The known frames of the whole take: the energy as a curve, unreliable frames as red marks above it.

    at: position of the shown frame, 0 to 1.
    """
    bins, height = len(overview.known), _TIMELINE_HEIGHT
    top = float(overview.energy_px.max()) or 1.0
    known = "".join(
        f'<rect x="{start}" y="8" width="{stop - start}" height="{height - 8}" fill="{_KNOWN}"/>'
        for start, stop in _runs(overview.known)
    )
    marks = "".join(
        f'<rect x="{start}" y="0" width="{max(stop - start, 1)}" height="6" fill="{_MARK}"/>'
        for start, stop in _runs(overview.distrusted)
    )
    curves = "".join(
        f'<polyline fill="none" stroke="{_CURVE}" stroke-width="1.2" vector-effect="non-scaling-stroke" '
        f'points="{_points(overview, start, stop, top)}"/>'
        for start, stop in _runs(overview.known)
    )
    x = at * bins
    return (
        f'<svg id="timeline" viewBox="0 0 {bins} {height}" preserveAspectRatio="none" '
        f'style="width:calc(100% - 24px);margin:6px 12px;height:{height}px;display:block;background:#f0f4f8;'
        'border-radius:4px">'
        f'{known}{curves}{marks}<line x1="{x:.2f}" x2="{x:.2f}" y1="0" y2="{height}" stroke="{_CURSOR}" '
        'stroke-width="2" vector-effect="non-scaling-stroke"/></svg>'
    )


def _runs(flags: "np.typing.NDArray[np.bool_]") -> list[tuple[int, int]]:
    """Begin and end of each run of true flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _points(overview: Overview, start: int, stop: int, top: float) -> str:
    """A curve over the bins of a run, its highest point below the marks."""
    y = _TIMELINE_HEIGHT - 2 - (_TIMELINE_HEIGHT - 14) * overview.energy_px[start:stop] / top
    return " ".join(f"{start + i + 0.5:.1f},{value:.1f}" for i, value in enumerate(y.tolist()))


def legend(colours: Sequence[tuple[tuple[int, ...], str]]) -> str:
    """Coloured dots with what they stand for: (RGB, words)."""
    dots = "".join(
        '<span style="white-space:nowrap;margin-right:14px"><span style="display:inline-block;width:10px;'
        f'height:10px;border-radius:5px;background:rgb{rgb};margin:0 4px 0 0"></span>'
        f"{html.escape(words)}</span>"
        for rgb, words in colours
    )
    return f'<div style="font:13px system-ui,sans-serif;padding:4px 12px">{dots}</div>'


def notice(sentence: str) -> str:
    """A highlighted sentence."""
    return (
        '<div style="font:13px system-ui,sans-serif;padding:8px 12px;color:#7b341e;background:#fffaf0;'
        f'border-left:3px solid #dd6b20">{html.escape(sentence)}</div>'
    )


def verdict_strip(verdict: Verdict) -> str:
    """The verdict on a result: its level by colour, hatched where it is not good; its doubts and causes."""
    ink, ground, edge = _LEVELS[verdict.level]
    hatch = f"repeating-linear-gradient(45deg,{edge} 0 4px,{ground} 4px 9px)"
    doubts = [f"Doubtful: {verdict.doubts_in_words}."] if verdict.doubts else []
    lines = "".join(
        f'<div style="margin-top:3px">{html.escape(line)}</div>'
        for line in [*doubts, *map(str, verdict.causes)]
    )
    return (
        f'<div id="verdict" style="display:flex;color:{ink};background:{ground};'
        'font:13px system-ui,sans-serif">'
        f'<div style="flex:0 0 14px;background:{edge if verdict.level == "good" else hatch}"></div>'
        '<div style="padding:6px 10px;overflow-wrap:anywhere;max-height:180px;overflow-y:auto">'
        f"<strong>{html.escape(verdict.headline)}</strong>{lines}</div></div>"
    )


def lines_of(rows: Sequence[tuple[str, str]]) -> str:
    """A small table of names and values."""
    cells = "".join(
        f'<tr><td style="color:#627d98;padding-right:10px">{html.escape(name)}</td>'
        f'<td style="font-variant-numeric:tabular-nums">{html.escape(value)}</td></tr>'
        for name, value in rows
    )
    return (
        f'<table style="font:13px system-ui,sans-serif;border-spacing:0;margin:6px 12px 2px">{cells}</table>'
    )
