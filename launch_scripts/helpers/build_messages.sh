#!/usr/bin/env bash
# Build depth_pose_msgs into a virtual environment that has the ROS wheels: build_messages.sh VENV
#
# With it come the parts of tf2_msgs and hri_msgs that the wheels lack (ros_ws/wheel_only), each only
# where that package is not there, or was built by this script.
# The messages land in the environment itself, so that its plain Python finds them and no
# setup.bash has to be sourced.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
venv=$(cd "$1" && pwd)
source "$root/launch_scripts/helpers/missing_interfaces.sh"
work=$venv/depth_pose_build

unset PYTHONPATH PYTHONHOME COLCON_PREFIX_PATH LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
export VIRTUAL_ENV=$venv PATH=$venv/bin:$PATH AMENT_PREFIX_PATH=$venv CMAKE_PREFIX_PATH=$venv

paths=("$root/ros_ws/src/depth_pose_msgs") packages=(depth_pose_msgs)
for name in $(missing_interfaces "$venv" "$root/ros_ws/wheel_only"); do
    paths+=("$root/ros_ws/wheel_only/$name") packages+=("$name")
done

rm -rf "$work"
mkdir -p "$work"
cd "$work"
"$venv/bin/colcon" --log-base "$work/log" build \
    --base-paths "${paths[@]}" --packages-select "${packages[@]}" \
    --build-base "$work/build" --merge-install --install-base "$venv" \
    --event-handlers console_direct- console_cohesion- \
    --cmake-args -G Ninja -DBUILD_TESTING=OFF -DCMAKE_BUILD_TYPE=Release \
    "-DPython3_EXECUTABLE=$venv/bin/python" \
    "-DCMAKE_PROJECT_TOP_LEVEL_INCLUDES=$root/launch_scripts/helpers/drop_wheel_includes.cmake"
cd "$root"
"$venv/bin/python" - <<'PYTHON'
from depth_pose_msgs.msg import Skeleton
from hri_msgs.msg import Skeleton2D
from tf2_msgs.msg import TFMessage

for kind in (Skeleton, Skeleton2D, TFMessage):
    kind.__class__.__import_type_support__()
PYTHON
rm -rf "$work"
