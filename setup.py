"""The parts of the packaging that colcon reads; everything else stands in pyproject.toml."""

from setuptools import setup

setup(
    license="Apache-2.0",
    python_requires=">=3.10,<3.13",
    entry_points={
        "console_scripts": [
            "depth-pose = depth_pose.cli:main",
            "denoise_node = depth_pose.ros.nodes.denoise_node:main",
            "matcher_node = depth_pose.ros.nodes.matcher_node:main",
            "refine_node = depth_pose.ros.nodes.refine_node:main",
            "recovery_node = depth_pose.ros.nodes.recovery_node:main",
            "volume_node = depth_pose.ros.nodes.volume_node:main",
        ],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/depth_pose"]),
        ("share/depth_pose", ["package.xml"]),
        ("share/depth_pose/launch", ["launch_scripts/depth_pose.launch.py"]),
        ("share/depth_pose/config", ["launch_scripts/params.yaml"]),
    ],
)
