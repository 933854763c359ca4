#!/usr/bin/env bash
# From a depth recording to skeletons, live through the four nodes: demo.sh [--view] [RECORDING.mcap]
#
# Without an argument a virtual time-of-flight sensor makes the recording. The skeletons and a picture
# of them come into results/; --view shows them in a browser at the end. Sets everything up the first time; again and again after that.
set -euo pipefail

view=
if [ "${1:-}" = --view ]; then
    view=1
    shift
fi
recording=
if [ $# -gt 1 ]; then
    echo "demo.sh takes one recording, or none: demo.sh [--view] [RECORDING.mcap]" >&2
    exit 1
elif [ $# -eq 1 ]; then
    recording=$(realpath -e -- "$1" 2>/dev/null) || {
        echo "There is no recording $1; give an MCAP file, or nothing for a simulated one." >&2
        exit 1
    }
fi

cd "$(dirname "${BASH_SOURCE[0]}")/.."
source launch_scripts/helpers/console.sh
source launch_scripts/helpers/environment.sh
bash launch_scripts/setup.sh
source launch_scripts/helpers/prepare.sh
prepare

say "Running the main job: the recording in real time through the four nodes"
.venv/bin/depth-pose demo ${recording:+"$recording"}
name=$(basename -- "${recording:-demo.mcap}")
look=(.venv/bin/depth-pose view "${recording:-bags/demo.mcap}" "results/${name%.*}_skeleton.mcap")
if [ -n "$view" ]; then
    say "done; the viewer"
    exec "${look[@]}"
fi
say "done; to see it in a browser: ${look[*]}"
