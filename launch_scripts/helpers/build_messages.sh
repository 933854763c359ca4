#!/usr/bin/env bash
# Build depth_pose_msgs into a virtual environment that has the ROS wheels: build_messages.sh VENV
#
# The messages land in the environment itself, so that its plain Python finds them and no
# setup.bash has to be sourced.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
venv=$(cd "$1" && pwd)
work=$venv/depth_pose_build

unset PYTHONPATH PYTHONHOME COLCON_PREFIX_PATH LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
export VIRTUAL_ENV=$venv PATH=$venv/bin:$PATH AMENT_PREFIX_PATH=$venv CMAKE_PREFIX_PATH=$venv

rm -rf "$work"
mkdir -p "$work"
cd "$work"
"$venv/bin/colcon" --log-base "$work/log" build \
    --base-paths "$root/ros_ws/src/depth_pose_msgs" \
    --build-base "$work/build" --merge-install --install-base "$venv" \
    --event-handlers console_direct- console_cohesion- \
    --cmake-args -G Ninja -DBUILD_TESTING=OFF -DCMAKE_BUILD_TYPE=Release \
    "-DPython3_EXECUTABLE=$venv/bin/python" \
    "-DCMAKE_PROJECT_TOP_LEVEL_INCLUDES=$root/launch_scripts/helpers/drop_wheel_includes.cmake"
cd "$root"
"$venv/bin/python" -c 'import depth_pose_msgs.msg; depth_pose_msgs.msg.Skeleton.__class__.__import_type_support__()'
rm -rf "$work"
