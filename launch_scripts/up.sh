#!/usr/bin/env bash
# The four nodes on a live sensor, until Ctrl-C: up.sh [--sensor NAME] [OPTIONS of depth-pose up]
#
# For machines without ROS; those who have `launch` take depth_pose.launch.py. Sets everything up the
# first time.
set -euo pipefail

cd "$(dirname "${BASH_SOURCE[0]}")/.."
source launch_scripts/helpers/console.sh
source launch_scripts/helpers/environment.sh
bash launch_scripts/setup.sh
source launch_scripts/helpers/prepare.sh
prepare

exec .venv/bin/depth-pose up "$@"
