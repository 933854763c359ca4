"""The four nodes, for those who have ``launch`` (it comes with ROS 2 from apt).

ros2 launch depth_pose depth_pose.launch.py sensor:=realsense
ros2 launch depth_pose depth_pose.launch.py params_file:=/path/params.yaml namespace:=left
"""

from collections.abc import Callable
from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

# importing the package names the shared-memory transport for the nodes started here
from depth_pose.ros.process.runner import END_WITH_PARENT, EXIT_CONFIG
from depth_pose.ros.process.supervisor import NODES, SENSORS_PATH, sensor_names

ARGUMENTS = {
    "sensor": ("", "topics of a known driver"),
    "params_file": ("", "ROS parameter file with the key /**:"),
    "bank": ("", "exemplar bank; empty: the one that the set-up built"),
    "namespace": ("depth_pose", "where the topics lie"),
    "use_sim_time": ("false", "take the time from /clock, for recordings"),
    "autostart": ("true", "false: the nodes wait to be configured and activated (lifecycle)"),
}
CHOICES = {"sensor": ["", *sensor_names()], "use_sim_time": ["true", "false"], "autostart": ["true", "false"]}


def make_nodes(context: LaunchContext) -> list[Node]:
    """Make the nodes once the arguments are known."""
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    parameters = [{name: value[name] == "true" for name in ("use_sim_time", "autostart")}]
    if value["sensor"]:
        parameters.append(str(SENSORS_PATH / f"{value['sensor']}.yaml"))
    if value["params_file"]:
        if not Path(value["params_file"]).is_file():
            raise RuntimeError(f"there is no parameter file {value['params_file']}")
        parameters.append(str(Path(value["params_file"]).absolute()))
    if value["bank"]:
        parameters.append({"bank": value["bank"]})
    return [
        Node(
            package="depth_pose",  # whose programs name the interpreter of the environment they were built in
            executable=f"{name}_node",
            name=name,
            namespace=value["namespace"],
            parameters=parameters,
            additional_env={END_WITH_PARENT: "1"},
            output="screen",
            respawn=True,
            respawn_delay=0.5,
            on_exit=end_if_refused(name),
        )
        for name in NODES
    ]


def end_if_refused(name: str) -> Callable[[ProcessExited, LaunchContext], Shutdown | None]:
    """Give what happens when a node ends: all end where its settings are wrong, else it is started again."""

    def on_exit(event: ProcessExited, context: LaunchContext) -> Shutdown | None:
        if event.returncode != EXIT_CONFIG:
            return None
        return Shutdown(reason=f"the {name} node refuses its settings; it has said which")

    return on_exit


def generate_launch_description() -> LaunchDescription:
    """Give the description to ``ros2 launch``."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=help, choices=CHOICES.get(name))
        for name, (default, help) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=make_nodes)])
