"""A driver that was started without the shipped profile: what arrives, and what is said of the rest."""

from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from peer import RELIABLE
from sensor_msgs.msg import Image

from depth_pose.ros import LOCAL_PROFILE_PATH, PROFILE_VARIABLE

IMAGES = 120
DRIVER = str(Path(__file__).with_name("stock_driver.py"))


@pytest.fixture
def drive(start, peer, monkeypatch):
    """Run the node with such a driver; give the node's diagnostics and what it said."""

    def run(reliability):
        node = start("-m", "depth_pose.ros.nodes.denoise_node")
        node.wait_for("is ready")
        told = peer.listen(DiagnosticArray, "/diagnostics", RELIABLE)
        monkeypatch.delenv(PROFILE_VARIABLE)
        driver = start(DRIVER, reliability, str(IMAGES))
        monkeypatch.setenv(PROFILE_VARIABLE, str(LOCAL_PROFILE_PATH))
        peer.until(lambda: driver.process.poll() is not None, what=lambda: f"its end:\n{driver.output}\nit")
        assert f"sent {IMAGES}" in driver.output
        peer.spin(1.5)
        return [message.status[0] for message in told], node.output

    return run


def counts(told):
    return {v.key: v.value for v in told[-1].values}


def test_a_reliable_driver_is_subscribed_to_reliably(drive):
    told, output = drive("reliable")
    answered = int(counts(told)["answered"])
    lost = int(counts(told).get("dropped: lost in transport", 0))
    assert lost <= 0.15 * IMAGES and answered + int(counts(told)["dropped"]) >= 0.95 * IMAGES, output
    assert answered > 0, output  # how many depends on the machine: what a busy node missed was not lost


def test_losses_of_a_best_effort_driver_are_a_warning_with_the_cure(drive, peer):
    peer.node.create_publisher(Image, "/camera/depth/image_raw", 1)  # as one that was killed stays known
    told, output = drive("best_effort")
    assert int(counts(told)["dropped: lost in transport"]) > 0
    warned = [s for s in told if s.level == DiagnosticStatus.WARN and "lost in transport" in s.message]
    assert warned
    assert f"start the sensor's driver with {PROFILE_VARIABLE}={LOCAL_PROFILE_PATH}" in output
