# Sourced by the launch scripts after the set-up: prepare compiles the kernels, once, which the first run would else
# wait for.

prepare() {
    if [ -f .venv/depth_pose_stamps/kernels ]; then return; fi
    say "Compiling the kernels (once)"
    if .venv/bin/python - >.venv/depth_pose_logs/kernels.log 2>&1 <<'PYTHON'; then
from depth_pose import Tracker
from depth_pose.detect.sample_frame import sample_frame

Tracker(quiet=True)(sample_frame())
PYTHON
        touch .venv/depth_pose_stamps/kernels
        say "kernels: compiled"
    else # whoever needs them compiles them
        say "kernels: not compiled yet; .venv/depth_pose_logs/kernels.log says why"
    fi
}
