#!/usr/bin/env bash
# Make .venv, the Python environment with ROS 2, the messages and depth_pose: setup.sh [--test]
#
# What is done is remembered by the content of the files it depends on, so a second run takes no time
# and a changed file repeats only its own steps. DEPTH_POSE_PYTHON names another Python to use.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
source launch_scripts/helpers/console.sh
source launch_scripts/helpers/find_python.sh

extras=ros,ros-build
if [ "${1:-}" = --test ]; then
    extras=$extras,test
elif [ -n "${1:-}" ]; then
    fail "setup.sh knows no option $1; it has --test"
fi

# A sourced ROS or another environment must not leak into this one.
unset PYTHONPATH PYTHONHOME VIRTUAL_ENV AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH
unset LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
export PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_COMPILE=1 PIP_PROGRESS_BAR=off

venv=$root/.venv
logs=$venv/depth_pose_logs
stamps=$venv/depth_pose_stamps

exec 9<"${BASH_SOURCE[0]}" # one set-up at a time
flock 9

digest() { sha256sum | cut -c 1-16; }
is_done() { [ "$(cat "$stamps/$1" 2>/dev/null)" = "$2" ]; }
set_done() { echo "$2" >"$stamps/$1"; }

if [ "$(uname -sm)" != "Linux x86_64" ]; then
    fail "ROS 2 comes as Python packages for Linux on x86-64 only, and this is $(uname -sm)." \
        "Install ROS 2 Jazzy with apt and build with colcon; README.md has the lines."
fi

# An environment is tied to its folder, and a copied or half-made one is of no use.
venv_key=$root
if ! is_done venv "$venv_key" || ! "$venv/bin/python" -c 'import pip' 2>/dev/null; then
    find_python
    say "Setting up .venv with $("$python" -V) (once; about a minute and 1.6 GB)"
    rm -rf "$venv"
    "$python" -m venv "$venv"
    mkdir -p "$stamps"
    set_done venv "$venv_key"
fi
mkdir -p "$logs" "$stamps"
version=$("$venv/bin/python" -V)

ros_key=$( (echo "$version"; sed -n '/^ros = \[/,/^test = \[/p' pyproject.toml) | digest)
messages_key=$( (
    echo "$ros_key"
    find ros_ws/src launch_scripts/helpers/build_messages.sh launch_scripts/helpers/drop_wheel_includes.cmake \
        -type f | LC_ALL=C sort | xargs sha256sum
) | digest)
packages_key=$( (echo "$version"; cat pyproject.toml setup.py) | digest)

install() { "$venv/bin/python" -m pip install "$@"; }
install_ros() {
    "$venv/bin/python" launch_scripts/helpers/requirements.py numpy ros ros-build >"$logs/ros.txt"
    install -r "$logs/ros.txt"
}

if ! is_done ros "$ros_key"; then
    install_ros >"$logs/ROS 2.log" 2>&1 &
    job_pids["ROS 2"]=$!
    run_jobs "$logs"
    set_done ros "$ros_key"
fi
# The compiler and the downloads share the time.
if ! is_done messages "$messages_key"; then
    bash launch_scripts/helpers/build_messages.sh "$venv" >"$logs/messages.log" 2>&1 &
    job_pids[messages]=$!
fi
if ! is_done "packages-$extras" "$packages_key"; then
    install --no-build-isolation -e ".[$extras]" >"$logs/packages.log" 2>&1 &
    job_pids[packages]=$!
fi
run_jobs "$logs"
set_done messages "$messages_key"
set_done "packages-$extras" "$packages_key"
