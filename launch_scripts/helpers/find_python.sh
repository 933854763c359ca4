# Sourced by setup.sh: sets python to a Python 3.10 to 3.12 that can make the environment,
# or ends with the apt line that brings what is missing.

# missing_parts PYTHON: the apt packages that PYTHON still needs, on one line.
missing_parts() {
    "$1" - <<'PYTHON'
import importlib.util, os, sys, sysconfig
version = "python%d.%d" % sys.version_info[:2]
if not (importlib.util.find_spec("venv") and importlib.util.find_spec("ensurepip")):
    print(version + "-venv", end=" ")
if not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")):
    print(version + "-dev", end=" ")
PYTHON
}

find_python() {
    local name missing="" found="" compiler=""
    for name in ${DEPTH_POSE_PYTHON:-python3.12 python3.11 python3.10 python3}; do
        # Run it: a name on the path may be a shim that leads nowhere.
        "$name" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 12))' \
            >/dev/null 2>&1 || continue
        missing=$(missing_parts "$name")
        if [ -z "$missing" ]; then
            found=$name
            break
        fi
        found=${found:-$name}
    done
    if ! command -v g++ >/dev/null && ! command -v c++ >/dev/null; then compiler=g++; fi
    if [ -z "$found" ]; then
        fail "No usable Python 3.10, 3.11 or 3.12 was found (tried: ${DEPTH_POSE_PYTHON:-python3.12 python3.11 python3.10 python3})." \
            "On Debian 12 or Ubuntu 24.04 this installs one with all that is needed:" \
            "    sudo apt-get update && sudo apt-get install -y python3 python3-venv python3-dev g++" \
            "A Python elsewhere can be named: DEPTH_POSE_PYTHON=/path/to/python3.12"
    fi
    missing=$(missing_parts "$found")
    missing="$missing$compiler"
    if [ -n "$missing" ]; then
        fail "The system lacks parts that $found needs to make the environment. This installs them:" \
            "    sudo apt-get update && sudo apt-get install -y ${missing% }"
    fi
    python=$found
}
