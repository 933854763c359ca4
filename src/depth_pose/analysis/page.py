"""A report as one HTML page: plain words, tables, and plots in it; it needs no other file."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from html import escape
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from depth_pose import __version__
from depth_pose.analysis.gait import Gait
from depth_pose.analysis.measures import Measure
from depth_pose.analysis.ranges import Range
from depth_pose.analysis.report import PersonReport, Report
from depth_pose.analysis.rising import pelvis_share
from depth_pose.analysis.steps import SIDES
from depth_pose.body.angle_definitions import JOINT_ANGLE_INDEX
from depth_pose.core.printable import printable
from depth_pose.core.sketch import LEFT, MIDDLE, RIGHT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = {"left": LEFT, "right": RIGHT, "": MIDDLE}

_WORDS = {
    "speed": "Walking speed, between the first and the last strike",
    "cadence": "Steps per minute",
    "step length": "From one foot's print to the other's, along the way",
    "step width": "Between the feet, across the way",
    "stride time": "From a foot's heel strike to its next",
    "stance": "Part of the stride in which the foot stands",
    "swing": "Part of the stride in which the foot swings",
    "double support": "Part of the stride in which both feet stand",
    "symmetry of step length": "Left minus right, over their mean; 0 is equal",
    "symmetry of stance": "Left minus right, over their mean; 0 is equal",
    "rises": "Times that the person stood up from a seat",
    "time of a rise": "From 5 to 95 % of the way of the pelvis",
    "time of sitting down": "From 95 to 5 % of the way of the pelvis",
    "time of five rises": "From the first rise's beginning to the fifth's end",
    "sway forward and back": "Root mean square of the centre of mass",
    "sway to the sides": "Root mean square of the centre of mass",
    "speed of sway": "Mean speed of the centre of mass, slower than one swing a second",
    "area of sway (95 %)": "Ellipse that holds 95 % of the places of the centre of mass",
}
"""Measures in plain words."""

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 60em; margin: 2em auto; padding: 0 1em; }
h1 { font-size: 1.6em; } h2 { font-size: 1.3em; border-bottom: 2px solid #ddd; margin-top: 2em; }
h3 { font-size: 1.1em; margin: 1.4em 0 .4em; }
table { border-collapse: collapse; width: 100%; } th, td { padding: .25em .6em; text-align: left; }
th { border-bottom: 1px solid #888; font-weight: 600; } td { border-bottom: 1px solid #eee; vertical-align:
top; } td.n, th.n { text-align: right; white-space: nowrap; } .word, .why { color: #666; font-size: .9em; }
.why { font-style: italic; } svg { max-width: 100%; height: auto; } figure { margin: .8em 0; }
figcaption { color: #666; font-size: .9em; } .left { color: #b85f0c; } .right { color: #136f93; }
@media print { h2 { break-before: page; } h2:first-of-type { break-before: auto; } figure { break-inside:
avoid; } }
"""


def page_of(report: Report) -> str:
    """Return the page, complete, as text."""
    name = escape(printable(report.name))
    parts = [
        "<!DOCTYPE html>",
        '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width">',
        f"<title>Movement report: {name}</title><style>{_STYLE}</style></head><body>",
        f"<h1>Movement report: {name}</h1>",
        f"<p>{report.frames} frames at {report.rate_hz:.1f} a second. "
        f"The floor is {escape(printable(report.floor))}. "
        "Numbers are given as value ± one standard deviation: the truth lies within it in two of three "
        "cases, within twice of it in 19 of 20. "
        "This is a measurement from a depth camera, not a diagnosis.</p>",
    ]
    if report.left_out:
        others = escape(printable(", ".join(report.left_out)))
        parts.append(f'<p class="word">Seen for too short a time, and left out: {others}.</p>')
    for person in report.people:
        parts += _person(person)
    parts.append(f'<p class="word">Made by depth_pose {__version__}. Definitions: its manual, page Gait.</p>')
    return "\n".join([*parts, "</body></html>"]) + "\n"


def _person(person: PersonReport) -> Iterable[str]:
    motion = person.motion
    seen = motion.present.sum() / motion.rate_hz
    yield f"<h2>{escape(printable(person.body_id))}</h2>"
    yield (
        f"<p>Seen for {seen:.1f} s, from second {motion.times[0]:.1f} to {motion.times[-1]:.1f}. Colours: "
        '<span class="left">left</span>, <span class="right">right</span>.</p>'
    )
    yield "<h3>Walking</h3>"
    yield from _table(person.gait.measures)
    if any(measure.is_known for measure in person.gait.measures):
        yield _figure(
            _footprints(person), "Footprints from above, in metres on the floor; the line is the pelvis."
        )
        yield _figure(
            _cycles(person),
            "Angles over the stride, from a foot's heel strike to its next: mean and, shaded, one deviation.",
        )
    yield "<h3>Rising from a chair</h3>"
    yield from _table(person.rising.measures)
    if person.rising.rises:
        yield _figure(
            _heights(person),
            "Height of the pelvis, 1 on straight legs; shaded: rises (dark) and descents (light).",
        )
    yield "<h3>Standing still</h3>"
    yield from _table(person.sway.measures)
    if len(person.sway.path):
        yield _figure(_sway(person), "The centre of mass from above, about its middle.")
    yield "<h3>Range of motion</h3>"
    yield '<p class="word">The least and the greatest of each angle in this recording, in degrees; 0 is '
    yield "standing upright. Not measured: what this recording does not show, with the reason.</p>"
    yield from _ranges(person.ranges)


def _table(measures: Sequence[Measure]) -> Iterable[str]:
    """Rows of measures; one line where all are refused for one reason."""
    reasons = {measure.reason for measure in measures}
    if len(reasons) == 1 and all(not measure.is_known for measure in measures):
        yield f'<p class="why">Not known: {escape(printable(reasons.pop()))}.</p>'
        return
    yield '<table><tr><th>measure</th><th class="n">value</th><th></th><th class="n">of</th></tr>'
    for m in measures:
        side = f' <span class="{m.side}">{m.side}</span>' if m.side else ""
        words = "" if m.side == "right" else f'<br><span class="word">{escape(_WORDS.get(m.name, ""))}</span>'
        name = f"<td>{escape(m.name)}{side}{words}</td>"
        if m.is_known:
            value = f'<td class="n">{_number(m)}</td><td>{escape(m.unit)}</td>'
            yield f'<tr>{name}{value}<td class="n">{_count(m)}</td></tr>'
        else:
            yield f'<tr>{name}<td colspan="3" class="why">not known: {escape(printable(m.reason))}</td></tr>'
    yield "</table>"


def _count(measure: Measure) -> str:
    return escape(f"{measure.count} {measure.of if measure.count != 1 else measure.of[:-1]}")


def _number(measure: Measure) -> str:
    """Format value and deviation with no more digits than the deviation justifies."""
    if measure.deviation == 0.0:
        return f"{measure.value:g}"
    digits = int(np.clip(1 - np.floor(np.log10(max(measure.deviation, 1e-9))), 0, 3))
    return f"{measure.value:.{digits}f} ± {measure.deviation:.{digits}f}"


def _ranges(ranges: Sequence[Range]) -> Iterable[str]:
    yield '<table><tr><th>angle</th><th class="n">least</th><th class="n">greatest</th><th class="n">±</th>'
    yield '<th class="n">frames</th></tr>'
    for r in ranges:
        side = next((s for s in SIDES if r.angle.startswith(s)), "")
        plain = r.angle.removeprefix(f"{side}_").replace("_", " ")
        name = f'<td>{plain} <span class="{side}">{side}</span></td>' if side else f"<td>{plain}</td>"
        if r.reason:
            yield f'<tr>{name}<td colspan="4" class="why">not measured: {escape(r.reason)}</td></tr>'
        else:
            values = (f"{r.low:.0f}", f"{r.high:.0f}", f"{r.deviation:.0f}", str(r.frames))
            yield f"<tr>{name}{''.join(f'<td class=n>{value}</td>' for value in values)}</tr>"
    yield "</table>"


def _new_figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _figure(figure: Figure, caption: str) -> str:
    """Return a figure as SVG in the page; the same figure gives the same text."""
    from matplotlib import rc_context

    stream = io.StringIO()
    with rc_context({"svg.hashsalt": "depth_pose", "svg.fonttype": "none"}):
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    picture = stream.getvalue()
    return f"<figure>{picture[picture.index('<svg') :]}<figcaption>{escape(caption)}</figcaption></figure>"


def _plain(axes: Axes) -> None:
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)


def _footprints(person: PersonReport) -> Figure:
    figure = _new_figure(8.0, 3.2)
    axes = figure.add_subplot()
    ways = [person.motion.at("pelvis")[walk.first : walk.end, :2] for walk in person.gait.walks]
    labels, order = ["away from the sensor, m", "to its left, m"], [0, 1]
    if np.ptp(np.concatenate(ways)[:, 1]) > np.ptp(np.concatenate(ways)[:, 0]):
        order = [1, 0]  # the longer way lies across the page
    for walk, way in zip(person.gait.walks, ways, strict=True):
        axes.plot(*way[:, order].T, color=MIDDLE, lw=0.8)
        for event in walk.events:
            axes.plot(*event.place[order], "o", ms=7, color=_COLOURS[event.side], alpha=0.8)
    axes.set(aspect="equal", adjustable="datalim")
    axes.set(xlabel=labels[order[0]], ylabel=labels[order[1]])
    _plain(axes)
    return figure


_CYCLE_ANGLES = ("hip_flexion", "knee_flexion", "ankle_dorsiflexion")
_PARTS = np.linspace(0.0, 100.0, 51)


def _cycles(person: PersonReport) -> Figure:
    figure = _new_figure(8.0, 2.9)
    for axes, name in zip(figure.subplots(1, len(_CYCLE_ANGLES)), _CYCLE_ANGLES, strict=True):
        for side in SIDES:
            curves = _strides(person.gait, person, side, f"{side}_{name}")
            if not len(curves):
                continue
            known = np.isfinite(curves)
            count = np.where(known.any(axis=0), known.sum(axis=0), np.nan)
            mean = np.where(known, curves, 0.0).sum(axis=0) / count
            spread = np.sqrt(np.where(known, (curves - mean) ** 2, 0.0).sum(axis=0) / count)
            axes.plot(_PARTS, mean, color=_COLOURS[side], lw=1.6, label=side)
            axes.fill_between(_PARTS, mean - spread, mean + spread, color=_COLOURS[side], alpha=0.2, lw=0)
        axes.set(title=name.replace("_", " "), xlabel="% of the stride", xlim=(0, 100))
        _plain(axes)
    figure.axes[0].set_ylabel("degrees")
    return figure


def _strides(gait: Gait, person: PersonReport, side: str, name: str) -> Any:
    """Curves (N, 51) of an angle over the strides of a side; NaN where it is not measured."""
    motion, angle = person.motion, person.motion.angles[:, JOINT_ANGLE_INDEX[name]]
    out = []
    for walk in gait.walks:
        strikes = [event.strike for event in walk.events if event.side == side]
        for begin, end in pairwise(strikes):
            out.append(np.interp(begin + _PARTS / 100.0 * (end - begin), motion.times, angle))
    curves = [curve for curve in out if np.isfinite(curve).mean() > 0.8]
    return np.array(curves)


def _heights(person: PersonReport) -> Figure:
    figure = _new_figure(8.0, 2.4)
    axes = figure.add_subplot()
    axes.plot(person.motion.times, pelvis_share(person.motion), color="#333333", lw=1.2)
    for rise in person.rising.rises:
        axes.axvspan(rise.begin, rise.end, color=RIGHT, alpha=0.35 if rise.is_up else 0.12, lw=0)
    axes.set(xlabel="seconds", ylabel="height of the pelvis", ylim=(0, 1.15))
    _plain(axes)
    return figure


def _sway(person: PersonReport) -> Figure:
    figure = _new_figure(3.6, 3.4)
    axes = figure.add_subplot()
    axes.plot(-person.sway.path[:, 1], person.sway.path[:, 0], color=RIGHT, lw=0.9)
    axes.set(aspect="equal", xlabel="to the right, mm", ylabel="forward, mm", adjustable="datalim")
    _plain(axes)
    return figure
