#!/usr/bin/env bash
# Run all the checks and tests: test.sh [PYTEST ARGUMENT...], e.g. test.sh -k denoise
#
# Sets everything up the first time. The style and type checks are tests like the others
# (test/test_style.py), so pytest's last line speaks for everything.
set -euo pipefail

cd "$(dirname "${BASH_SOURCE[0]}")/.."
source launch_scripts/helpers/console.sh
source launch_scripts/helpers/environment.sh
bash launch_scripts/setup.sh --test
source launch_scripts/helpers/prepare.sh
prepare

# Nodes of other programs, and of another run of this one, are not to be heard.
export ROS_DOMAIN_ID=$((1 + RANDOM % 100)) ROS_AUTOMATIC_DISCOVERY_RANGE=SYSTEM_DEFAULT
export FASTRTPS_DEFAULT_PROFILES_FILE=$PWD/src/depth_pose/ros/fastdds_local.xml
say "Running the tests"
# Three at a time, in the groups that test/conftest.py makes: those of nodes mostly wait.
exec .venv/bin/python -m pytest -q -n 3 "$@"
