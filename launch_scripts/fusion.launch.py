"""The fusion node, for those who have ``launch``; each camera has its own depth_pose.launch.py.

ros2 launch depth_pose depth_pose.launch.py namespace:=cam_a/depth_pose params_file:=/path/cam_a.yaml
ros2 launch depth_pose fusion.launch.py rig:=/path/rig.yaml
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

# importing the package names the shared-memory transport for the node started here
from depth_pose.ros.process.runner import END_WITH_PARENT

ARGUMENTS = {
    "rig": ("", str, "rig file: names and places of the cameras"),
    "room_frame": ("room", str, "frame of the merged skeletons"),
    "tf": ("false", bool, "broadcast every joint on /tf"),
    "rep155": ("false", bool, "publish all people by REP-155"),
    "use_sim_time": ("false", bool, "take the time from /clock, for recordings"),
}


def generate_launch_description() -> LaunchDescription:
    """Give the description to ``ros2 launch``."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=help)
        for name, (default, _, help) in ARGUMENTS.items()
    ]
    given = {
        name: ParameterValue(LaunchConfiguration(name), value_type=kind)
        for name, (_, kind, _) in ARGUMENTS.items()
    }
    node = Node(
        package="depth_pose",
        executable="fusion_node",
        name="fusion",
        namespace="depth_pose",
        parameters=[given],
        additional_env={END_WITH_PARENT: "1"},
        output="screen",
        respawn=True,
        respawn_delay=0.5,
    )
    return LaunchDescription([*declared, node])
