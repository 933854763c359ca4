"""One line a minute tells that the nodes do not keep up, and none where they do."""

from depth_pose.ros.transport.pace import Pace


def lines(seconds: int, sent: int, begun: int, answered: int) -> list[tuple[int, str]]:
    """Play a sensor of ``sent`` frames a second; return the lines with their seconds."""
    pace, said = Pace(), []
    for now in range(seconds):
        if line := pace.look((sent - begun) * now, float(now)):
            said.append((now, line))
        for _ in range(begun):
            pace.begin()
        for _ in range(answered):
            pace.arrive()
    return said


def test_a_slow_machine_is_named_after_ten_seconds_and_then_once_a_minute() -> None:
    said = lines(200, sent=30, begun=20, answered=12)
    assert [now for now, _ in said] == [10, 70, 130, 190]
    assert all("12.0 of 30.0 frames a second" in line for _, line in said)


def test_a_window_begins_with_its_first_frame() -> None:
    pace = Pace()
    assert not any(pace.look(0, float(now)) for now in range(30))
    for now in range(30, 45):
        if line := pace.look(20 * (now - 30), float(now)):
            break
        pace.begin()
    assert now == 40 and "1.0 of 21.0 frames" in line


def test_who_keeps_up_is_not_told() -> None:
    assert not lines(200, sent=30, begun=30, answered=28)
    assert not lines(200, sent=30, begun=29, answered=0)  # no recovery node


def test_frames_that_were_never_begun_count() -> None:
    ((_, line), *_) = lines(15, sent=30, begun=5, answered=0)
    assert "5.0 of 30.0" in line
