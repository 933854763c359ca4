"""Share of a camera driver's images that arrive on one machine: C++ and rclpy, reliable and best effort.

    python benchmarks/drivers.py --times 3

The driver sends 240 images of 640 x 480 at 30 a second, with Fast DDS's own settings or the shipped profile;
a denoise node answers (docs/topics.md). The driver in C++ (`driver.cpp`) uses rcl, the library below rclcpp,
because rclcpp is not among the wheels. It needs a C++ compiler and the headers that the set-up installs.
"""

from __future__ import annotations

import argparse
import os
import random
import subprocess
import sys
import sysconfig
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

from depth_pose.ros import PROFILE_VARIABLE, stay_local

HERE = Path(__file__).parent
RCLPY = [sys.executable, str(HERE.parent / "test" / "ros" / "stock_driver.py")]
IMAGES, LIMIT_S = 240, 90.0
"""Number of images sent, and time limit of a driver, seconds."""


def compile_driver(folder: Path) -> list[str]:
    """Compile the C++ driver against the libraries of this environment; return its command."""
    prefix, made = Path(sys.prefix), folder / "driver"
    python = sysconfig.get_config_var("LIBDIR")
    command = ["c++", "-O1", "-std=c++17", HERE / "driver.cpp", "-o", made, f"-L{prefix / 'lib'}"]
    command += [f"-I{include}" for include in (prefix / "include").iterdir() if include.is_dir()]
    command += ["-lrcl", "-lrcutils", "-lrmw", "-lsensor_msgs__rosidl_typesupport_cpp"]
    command += [
        "-Wl,--no-as-needed",
        f"-L{python}",
        f"-Wl,-rpath,{python}",
    ]  # libraries of the wheels need it
    command += [f"-l:{sysconfig.get_config_var('INSTSONAME')}", "-Wl,--allow-shlib-undefined"]
    subprocess.run(command, check=True)
    return [str(made)]


def listen() -> dict[str, str]:
    """Return a dictionary that is updated with the denoise node's latest ``/diagnostics``."""
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray
    from parts.background_spin import spin_in_background

    told: dict[str, str] = {}

    def take(message: Any) -> None:
        for status in message.status:
            told.update({v.key: v.value for v in status.values})

    rclpy.init(args=[])
    node = rclpy.create_node("bench")
    node.create_subscription(DiagnosticArray, "/diagnostics", take, 10)
    spin_in_background(node)
    return told


def measure(driver: list[str], environment: dict[str, str], told: dict[str, str]) -> tuple[int, int]:
    """Run a driver with a denoise node; return the number of images answered and lost in transport."""
    command = [sys.executable, "-m", "depth_pose.ros.nodes.denoise_node"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as node:
        assert node.stdout is not None
        next(line for line in node.stdout if "is ready" in line)
        threading.Thread(target=node.stdout.read, daemon=True).start()
        time.sleep(1.5)  # the previous node's last diagnostics arrive
        told.clear()
        subprocess.run(driver, env=environment, check=True, stdout=subprocess.DEVNULL, timeout=LIMIT_S)
        time.sleep(1.5)
        node.terminate()
    return int(told.get("answered", 0)), int(told.get("dropped: lost in transport", 0))


def main() -> None:
    """Run the comparison and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--times", type=int, default=2, help="repetitions of each")
    arguments = parser.parse_args()
    os.environ.setdefault("ROS_DOMAIN_ID", str(random.SystemRandom().randrange(1, 101)))
    stay_local()
    own = dict(os.environ)
    stock = {name: value for name, value in own.items() if name != PROFILE_VARIABLE}
    told = listen()
    with tempfile.TemporaryDirectory() as folder:
        drivers = {"C++ (rcl)": compile_driver(Path(folder)), "rclpy": RCLPY}
        print(
            f"| driver | sent | settings | answered of {IMAGES} | lost in transport |\n|---|---|---|---|---|"
        )
        for language, command in drivers.items():
            for sent in ("reliable", "best_effort"):
                for settings, environment in (("Fast DDS's own", stock), ("the shipped profile", own)):
                    whole = [*command, sent, str(IMAGES)]
                    found = [measure(whole, environment, told) for _ in range(arguments.times)]
                    answered, lost = (", ".join(map(str, column)) for column in zip(*found, strict=True))
                    print(f"| {language} | {sent} | {settings} | {answered} | {lost} |", flush=True)
    print(f"load average {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
