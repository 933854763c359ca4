#!/usr/bin/env bash
# Make .venv, the Python environment with ROS 2, the messages and depth_pose: setup.sh [--test]
#
# What is done is remembered by the content of the files it depends on, so a second run takes no time
# and a changed file repeats only its own steps. DEPTH_POSE_PYTHON names another Python to use.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
source launch_scripts/helpers/console.sh
source launch_scripts/helpers/environment.sh
source launch_scripts/helpers/find_python.sh

with_test=
if [ "${1:-}" = --test ]; then
    with_test="test docs"
elif [ -n "${1:-}" ]; then
    fail "setup.sh knows no option $1; it has --test"
fi
if [ "$(uname -sm)" != "Linux x86_64" ]; then
    fail "ROS 2 comes as Python packages for Linux on x86-64 only, and this is $(uname -sm)." \
        "Install ROS 2 Jazzy with apt and build with colcon; README.md has the lines."
fi
export PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_PROGRESS_BAR=off

venv=$root/.venv
logs=$venv/depth_pose_logs
stamps=$venv/depth_pose_stamps
wheels=$venv/depth_pose_wheels

exec 9<"${BASH_SOURCE[0]}" # one set-up at a time
flock 9

digest() { sha256sum | cut -c 1-16; }
is_done() { [ "$(cat "$stamps/$1" 2>/dev/null)" = "$2" ]; }
set_done() { echo "$2" >"$stamps/$1"; }
pip() { "$venv/bin/python" -m pip "$@"; }
requirements() { "$venv/bin/python" launch_scripts/helpers/requirements.py "$@"; }

# start NAME COMMAND...: run it beside the others, into its log.
start() {
    local name=$1
    shift
    touch "$stamps/$name.unfinished" # stays behind only where it is killed
    (
        status=0
        "$@" || status=$?
        rm -f "$stamps/$name.unfinished"
        exit "$status"
    ) >"$logs/$name.log" 2>&1 &
    job_pids[$name]=$!
}
trap 'kill "${job_pids[@]}" 2>/dev/null || true' EXIT

install_ros() {
    requirements numpy ros ros-build >"$logs/ros.txt" && pip install --no-compile -r "$logs/ros.txt"
}
fetch_packages() {
    requirements dependencies sim view pictures gltf live ${with_test:+test docs} >"$logs/packages.txt" \
        && pip wheel --wheel-dir "$wheels" -r "$logs/packages.txt"
}
install_packages() {
    local from=()
    if [ -d "$wheels" ]; then from=(--no-index --find-links "$wheels"); fi
    pip install --no-compile "${from[@]}" --no-build-isolation -e ".[sim,view,pictures,gltf,live${with_test:+,test,docs}]" \
        && rm -rf "$wheels"
}

if [ -e "$venv" ] && [ ! -d "$stamps" ]; then
    fail "$venv was not made by this script; move it away or remove it"
fi
# An environment is tied to its folder, and a copied or half-made one is of no use.
if ! is_done venv "$root" || ! "$venv/bin/python" -c 'import pip' 2>/dev/null \
    || [ -n "$(find "$stamps" -name '*.unfinished')" ]; then
    find_python
    say "Making .venv with $("$python" -V) (once; a minute or two, 1.6 GB)"
    rm -rf "$venv"
    mkdir -p "$stamps" "$logs"
    "$python" -m venv "$venv"
    set_done venv "$root"
fi

version=$("$venv/bin/python" -V)
lock=${DEPTH_POSE_LOCK:-launch_scripts/locks/$("$venv/bin/python" -c 'import sys; print("%d.%d" % sys.version_info[:2])').txt}
if [ -f "$lock" ]; then # tested versions; for another Python, or with DEPTH_POSE_LOCK=none, pip chooses
    export PIP_CONSTRAINT=$root/$lock
    version+=$(cat "$lock")
fi
ros_key=$( (echo "$version"; sed -n '/^\[dependency-groups\]/,/^\[tool/p' pyproject.toml) | digest)
messages_key=$( (
    echo "$ros_key"
    find ros_ws/src/depth_pose_msgs ros_ws/wheel_only launch_scripts/helpers/build_messages.sh \
        launch_scripts/helpers/missing_interfaces.sh launch_scripts/helpers/drop_wheel_includes.cmake -type f | LC_ALL=C sort | xargs sha256sum
) | digest)
packages_key=$( (echo "$version"; sed '/^\[tool\.pytest/,$d' pyproject.toml) | digest)

packages_done=
if is_done packages "$packages_key"; then packages_done=1; fi
if [ -n "$with_test" ] && ! is_done packages-test "$packages_key"; then packages_done=; fi

# Two things at a time: downloads, unpacking and the compiler share the cores.
if ! is_done ros "$ros_key"; then start ros install_ros; fi
if [ ! -f "$stamps/packages" ]; then start downloads fetch_packages; fi
run_jobs "$logs"
set_done ros "$ros_key"
if ! is_done messages "$messages_key"; then
    start messages bash launch_scripts/helpers/build_messages.sh "$venv"
fi
if [ -z "$packages_done" ]; then start packages install_packages; fi
run_jobs "$logs"
set_done messages "$messages_key"
set_done packages "$packages_key"
if [ -n "$with_test" ]; then set_done packages-test "$packages_key"; fi
