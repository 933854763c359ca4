"""The four nodes, for those who have ``launch`` (it comes with ROS 2 from apt).

ros2 launch depth_pose depth_pose.launch.py sensor:=realsense
ros2 launch depth_pose depth_pose.launch.py params_file:=/path/params.yaml namespace:=left
"""

import sys
from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

# importing the package names the shared-memory transport for the nodes started here
from depth_pose.ros.process.supervisor import NODES, SENSORS_PATH, sensor_names

ARGUMENTS = {
    "sensor": ("", f"topics of a known driver: {', '.join(sensor_names())}"),
    "params_file": ("", "ROS parameter file with the key /**:"),
    "bank": ("", "exemplar bank; empty: the one that the set-up built"),
    "namespace": ("depth_pose", "where the topics lie"),
    "use_sim_time": ("false", "take the time from /clock, for recordings"),
    "autostart": ("true", "false: the nodes wait to be configured and activated (lifecycle)"),
}


def make_nodes(context: LaunchContext) -> list[Node]:
    """Make the nodes once the arguments are known."""
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    parameters = [{name: value[name].lower() == "true" for name in ("use_sim_time", "autostart")}]
    if value["sensor"]:
        parameters.append(str(SENSORS_PATH / f"{value['sensor']}.yaml"))
    if value["params_file"]:
        parameters.append(str(Path(value["params_file"]).absolute()))
    if value["bank"]:
        parameters.append({"bank": value["bank"]})
    return [
        Node(
            executable=sys.executable,
            arguments=["-m", f"depth_pose.ros.nodes.{name}_node"],
            name=name,
            namespace=value["namespace"],
            parameters=parameters,
            output="screen",
            respawn=True,
            respawn_delay=0.5,
        )
        for name in NODES
    ]


def generate_launch_description() -> LaunchDescription:
    """Give the description to ``ros2 launch``."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=help)
        for name, (default, help) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=make_nodes)])
