#!/usr/bin/env bash
# From a depth recording to skeletons, live through the four nodes: demo.sh [RECORDING.mcap]
#
# Without an argument a virtual time-of-flight sensor makes the recording. The skeletons and a picture
# of them come into results/. Sets everything up the first time; again and again after that.
set -euo pipefail

recording=
if [ $# -gt 1 ]; then
    echo "demo.sh takes one recording, or none: demo.sh [RECORDING.mcap]" >&2
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
source launch_scripts/helpers/bank.sh
ensure_bank

if [ -z "$recording" ]; then
    recording=bags/demo.mcap
    if [ ! -f "$recording" ]; then
        say "Simulating a time-of-flight sensor that watches a moving person"
        .venv/bin/depth-pose simulate -o bags/demo.partial.mcap
        mv bags/demo.partial.npz bags/demo.npz
        mv bags/demo.partial.mcap "$recording"
    fi
fi
say "Running the four nodes on $recording"
.venv/bin/depth-pose demo "$recording"
say "done"
