"""What nodes share with the process they are forked from."""

import os
import subprocess
import sys

from depth_pose.core.config import SmoothConfig
from depth_pose.ros.process.warm_stages import is_warm, load_bank, make, make_ahead


class Counted:
    """A stage that counts its warm-ups."""

    def __init__(self, config):
        self.config, self.warmed = config, 0

    def warm_up(self):
        self.warmed += 1


def test_a_stage_made_ahead_is_given_once_and_for_equal_settings_only():
    make_ahead(Counted, SmoothConfig())
    first, second = make(Counted, SmoothConfig()), make(Counted, SmoothConfig())
    assert first is not second
    assert (first.warmed, second.warmed) == (1, 0)
    assert is_warm(first) and not is_warm(second)
    make_ahead(Counted, SmoothConfig())
    other = make(Counted, SmoothConfig(enabled=False))
    assert other.warmed == 0 and not other.config.enabled


def test_a_bank_is_read_once_until_its_file_changes(bank_path, tmp_path):
    path = tmp_path / "bank.npz"
    path.write_bytes(bank_path.read_bytes())
    first = load_bank(path)
    assert load_bank(path) is first
    os.utime(path, ns=(1, 1))
    again = load_bank(path)
    assert again is not first and again.bank_id == first.bank_id


def test_the_fork_server_has_one_thread_and_no_ros(bank_path):
    """A fork takes one thread along; loading Fast DDS starts others."""
    code = (
        "import os, sys; from depth_pose.ros.process import forkserver\n"
        f"forkserver._load({str(bank_path)!r})\n"
        "print(len(os.listdir('/proc/self/task')), 'rclpy' in sys.modules)"
    )
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    ran = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert ran.stdout.split() == ["1", "False"], ran.stderr
