"""Reports as files."""

from __future__ import annotations

import csv
import html.parser
from dataclasses import replace

import pytest
from walked import skeletons_of, write

from depth_pose.analysis import analyse_recording, write_report
from depth_pose.cli.app import app
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.io.mcap_write import SkeletonWriter
from depth_pose.offline import FLOOR
from depth_pose.sim.function import walk_straight


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    return write(tmp_path_factory.mktemp("walk") / "a & <b>.mcap", skeletons_of(walk_straight(30.0, 6.0, 1)))


class _Page(html.parser.HTMLParser):
    """A page's open tags, and its text."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.text, self.links = [], [], "", []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [v for k, v in attrs if k in ("href", "src", "xlink:href") and not v.startswith("#")]
        if tag not in ("meta", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def test_the_page_is_whole_and_needs_no_other_file(walk, tmp_path):
    report = analyse_recording(walk)
    write_report(report, tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    page = _Page(text)
    assert not page.open
    assert page.tags.count("svg") == 2  # footprints and angles over the stride
    assert not page.links
    assert "a & <b>.mcap" in page.text and "<b>" not in text.replace("&lt;b&gt;", "")
    assert "height to 1 cm" in page.text
    assert "Not known: nobody rises from a seat." in page.text
    write_report(report, tmp_path / "again.html")
    assert (tmp_path / "again.html").read_text(encoding="utf-8") == text


def test_the_table_has_a_row_a_measure(walk, tmp_path, capsys):
    app(["report", str(walk), "-o", str(tmp_path / "r.csv")], standalone_mode=False)
    said = capsys.readouterr().out
    assert "measures are known" in said and "nobody rises from a seat" in said
    with (tmp_path / "r.csv").open() as stream:
        rows = {(r["measure"], r["side"]): r for r in csv.DictReader(stream)}
    (person,) = analyse_recording(walk).people
    assert len(rows) == len(person.measures)
    for m in person.measures:
        row = rows[m.name, m.side]
        if m.is_known:
            assert float(row["value"]) == pytest.approx(m.value, abs=1e-6)
            assert int(row["frames"]) == m.frames
        else:
            assert row["value"] == "" and row["reason"] == m.reason
    knee = rows["knee flexion, greatest", "left"]
    assert 40 < float(knee["value"]) < 80 and 0 < float(knee["deviation"]) < 10


def test_wrong_wishes_are_refused(walk, tmp_path):
    with pytest.raises(ConfigError, match=r"one of \.html, \.csv"):
        app(["report", str(walk), "-o", str(tmp_path / "r.pdf")], standalone_mode=False)
    with pytest.raises(InputError, match="nobody with the id x"):
        analyse_recording(walk, people=["x"])
    brief = skeletons_of(walk_straight(30.0, 0.5, 1))
    with pytest.raises(InputError, match="nobody for 1 s"):
        analyse_recording(write(tmp_path / "brief.mcap", brief))


def test_a_sensor_that_moved_measures_angles_only(tmp_path):
    with SkeletonWriter(tmp_path / "moved.mcap") as writer:
        for skeleton in skeletons_of(walk_straight(30.0, 6.0, 1)):
            writer.write_people([replace(skeleton, body_id="a")], skeleton.stamp_ns, skeleton.frame_id)
        writer.write_metadata(FLOOR, {"moved": "yes"})
    (person,) = analyse_recording(tmp_path / "moved.mcap").people
    assert {m.reason for m in person.gait.measures} == {"the sensor moved while it recorded"}
    ranges = {r.angle: r for r in person.ranges}
    assert ranges["trunk_flexion"].reason == "it needs the floor"
    assert ranges["left_knee_flexion"].high > 40
