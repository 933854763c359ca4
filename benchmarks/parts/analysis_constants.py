"""Constants of the report: each one halved and doubled, and what that changes: `benchmarks/angles.py`.

Every number that a module of ``depth_pose.analysis`` defines, and those of `depth_pose.export.floor`, is a
row. The columns: walks whose cadence is known, mean errors of cadence (%) and of step length (cm), rises
counted, error of their time (ms), error of the sway's root mean square (mm), and errors of the floor that
feet show: height of the sensor (cm) and tilt (degrees). "same" is a report that is equal to the last digit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np

from depth_pose.analysis import analyse_recording
from depth_pose.analysis.measures import Measure
from depth_pose.analysis.sway import centre_of_mass
from depth_pose.core.errors import InputError
from depth_pose.export import floor as feet_floor
from depth_pose.export.tracks import read_tracks
from parts.changed_constant.factors import FACTORS, times
from parts.constants import changed, constants, shown

HEAD = "walks | cadence % | step cm | rises | rise ms | sway mm | floor cm | floor deg |"
"""Columns of a change."""

RISE_S = 1.2 * (1.0 - 2.0 * np.arccos(0.9) / np.pi)
"""Time from 5 to 95 % of a rise of `depth_pose.sim.function.sit_to_stand`, half a cosine of 1.2 s."""


@dataclass(frozen=True)
class Known:
    """A recording of skeletons of one person, and what is true of it; what it does not show is NaN.

    Attributes
    ----------
    skeletons : Path
    height, pitch_deg : float
        Of the camera.
    cadence, step : float
        Steps a minute; metres.
    rises : float
        Number of rises.
    sway : float
        Root mean square of the true centre of mass about its middle, on the floor, mm.
    """

    skeletons: Path
    height: float
    pitch_deg: float
    cadence: float = np.nan
    step: float = np.nan
    rises: float = np.nan
    sway: float = np.nan

    def numbers(self) -> tuple[list[float], str]:
        """Return the columns, and a digest of the report."""
        report = analyse_recording(self.skeletons)
        person = max(report.people, key=lambda one: one.motion.present.sum())
        found = {(m.group, m.name): m for m in person.measures if not m.side}
        text = "".join(str(m) for one in report.people for m in one.measures)
        cadence, step = (value_of(found, "gait", name) for name in ("cadence", "step length"))
        rising = "rising from a chair"
        count, rise = (value_of(found, rising, name) for name in ("rises", "time of a rise"))
        sway = np.hypot(*(value_of(found, "standing still", f"sway {way}") for way in WAYS))
        tilt, off = self._floor()
        numbers = [
            np.nan if np.isnan(self.cadence) else float(np.isfinite(cadence)),
            100.0 * abs(cadence / self.cadence - 1.0),
            100.0 * abs(step - self.step),
            np.nan if np.isnan(self.rises) else np.nan_to_num(count),
            1e3 * abs(rise - RISE_S) if self.rises > 0 else np.nan,
            abs(sway - self.sway),
            100.0 * off,
            tilt,
        ]
        return numbers, sha256(f"{text} {report.floor} {tilt} {off}".encode()).hexdigest()

    def _floor(self) -> tuple[float, float]:
        """Return how far the floor that feet show is off: degrees, metres."""
        try:
            floor = feet_floor.floor_of_feet(read_tracks(self.skeletons).people)
        except InputError:
            return float("nan"), float("nan")
        pitch = np.radians(self.pitch_deg)
        true = np.array([0.0, -np.cos(pitch), -np.sin(pitch)])
        return float(np.degrees(np.arccos(np.clip(floor.up @ true, -1, 1)))), abs(floor.height - self.height)


WAYS = ("forward and back", "to the sides")


def value_of(found: dict[tuple[str, str], Measure], group: str, name: str) -> float:
    """Return the value of a measure, NaN where it is not known."""
    measure = found.get((group, name))
    return measure.value if measure is not None else float("nan")


def true_sway(truth: Path) -> float:
    """Return the root mean square of the true centre of mass about its middle, both ways on the floor, mm."""
    joints = np.load(truth)["joints"].astype(float)
    centre = 1e3 * centre_of_mass(joints)
    return float(np.sqrt(np.sum(np.sort(centre.var(axis=0))[1:])))


def numbers_of(recordings: list[Known]) -> tuple[np.ndarray, list[str]]:
    """Return the means of the columns over the recordings that show them, sums of counts; digests."""
    numbers, digests = zip(*[known.numbers() for known in recordings], strict=True)
    table = np.array(numbers)
    means = np.nanmean(table, axis=0)
    means[[0, 3]] = np.nansum(table[:, [0, 3]], axis=0)
    return means, list(digests)


def sweep(recordings: list[Known], only: list[str]) -> None:
    """Print a table."""
    base, digests = numbers_of(recordings)
    print(f"of {len(recordings)} recordings: " + ", ".join(f"{value:.2f}" for value in base))
    print(f"| | value | {HEAD} {HEAD}\n|{'---|' * 18}", flush=True)
    for name, module, variable, value in of_reports():
        if name.startswith(tuple(only)):
            told = []
            for factor in FACTORS:
                with changed(module, variable, times(value, factor)):
                    told.append(change(recordings, base, digests))
            print(f"| {name} | {shown(value)} | {' | '.join(told)} |", flush=True)


def of_reports() -> Iterator[tuple]:
    """Give the numbers: name, module, variable and value."""
    yield from constants(("analysis",))
    yield from (row for row in constants(("export",)) if row[0].startswith("export.floor"))


def change(recordings: list[Known], base: np.ndarray, digests: list[str]) -> str:
    """Return the cells of one changed number."""
    try:
        numbers, now = numbers_of(recordings)
    except (ValueError, IndexError, InputError) as error:
        return f"out of range: {error} | | | | | | |"
    if now == digests:
        return "same | | | | | | |"
    return " | ".join(f"{value:+.2f}" for value in numbers - base)
