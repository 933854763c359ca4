"""What nodes share with the process they are forked from."""

import os
import subprocess
import sys

from depth_pose.core.config import SmoothConfig
from depth_pose.ros.process import warm_stages
from depth_pose.ros.process.warm_stages import is_warm, load_bank, make


class Counted:
    """A stage that counts frames."""

    def __init__(self, config):
        self.config, self.seen = config, 0

    def reset(self):
        self.seen = 0


def test_a_stage_made_ahead_is_given_as_if_new_and_for_equal_settings_only(monkeypatch):
    monkeypatch.setattr(warm_stages, "_made", {})
    first = warm_stages._keep(Counted, SmoothConfig())
    first.seen = 3
    assert make(Counted, SmoothConfig()) is first and first.seen == 0
    assert is_warm(first)
    other = make(Counted, SmoothConfig(enabled=False))
    assert other is not first and not other.config.enabled and not is_warm(other)


def test_a_bank_is_read_once_until_its_file_changes(bank_path, tmp_path):
    path = tmp_path / "bank.npz"
    path.write_bytes(bank_path.read_bytes())
    first = load_bank(path)
    assert load_bank(path) is first
    os.utime(path, ns=(1, 1))
    again = load_bank(path)
    assert again is not first and again.bank_id == first.bank_id


def test_the_host_has_no_threads_of_its_own_and_is_on_no_graph(bank_path):
    """A fork takes one thread along. Importing rclpy starts LTTng's, which forked nodes do without."""
    count = "print(len(os.listdir('/proc/self/task')), rclpy.ok())"
    loads = f"from depth_pose.ros.process import host; host.load({str(bank_path)!r})"
    said = []
    for first in ("pass", loads):
        code = f"import os, rclpy\n{first}\n{count}"
        ran = subprocess.run(
            [sys.executable, "-c", code],
            env=os.environ | {"OMP_NUM_THREADS": "1"}, capture_output=True, text=True
        )  # fmt: skip
        said.append(ran.stdout.split())
        assert said[-1], ran.stderr
    assert said[0] == said[1] and said[0][1] == "False"


KERNELS_AFTER = """
import sys
from depth_pose.ros.process import host
host.load(sys.argv[1])
import scene
from depth_pose.bank import Bank
from depth_pose.pipeline import PosePipeline

def loaded():
    return {
        (name, key): len(value.overloads)
        for name, module in list(sys.modules.items()) if name.startswith("depth_pose.")
        for key, value in vars(module).items() if hasattr(value, "overloads")
    }

pipeline, before = PosePipeline(Bank.load(sys.argv[1])), loaded()
answers = [len(pipeline.process_frame(frame).skeletons) for frame in scene.frames(8)]
print(answers, sorted(key for key, count in loaded().items() if count != before.get(key, 0)))
"""


def test_the_first_frames_load_no_kernel(domain, bank_path):
    """What a forked node loads itself, it loads while somebody waits for its first answer."""
    ran = subprocess.run(
        [sys.executable, "-c", KERNELS_AFTER, str(bank_path)], capture_output=True, text=True
    )
    assert ran.stdout.split("\n")[0] == "[1, 1, 1, 1, 1, 1, 1, 1] []", ran.stdout + ran.stderr
