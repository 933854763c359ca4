# Sourced by the launch scripts after the set-up: prepare does what the first run would else wait for. It builds
# the default exemplar bank where need be, and meanwhile compiles the kernels, once.
source launch_scripts/helpers/bank.sh

prepare() {
    local kernels=
    if [ ! -f .venv/depth_pose_stamps/kernels ]; then
        compile_kernels >.venv/depth_pose_logs/kernels.log 2>&1 &
        kernels=$!
        trap 'kill "$kernels" 2>/dev/null || true' EXIT
    fi
    ensure_bank
    if [ -z "$kernels" ]; then return; fi
    if wait "$kernels"; then
        touch .venv/depth_pose_stamps/kernels
        say "kernels: compiled"
    else # whoever needs them compiles them
        say "kernels: not compiled yet; .venv/depth_pose_logs/kernels.log says why"
    fi
    trap - EXIT
}

# Of the least recording and the least bank.
compile_kernels() (
    set -e
    folder=$(mktemp -d)
    trap 'rm -rf "$folder"' EXIT
    .venv/bin/depth-pose simulate -o "$folder/in.mcap" --motion wave --seconds 0.2
    .venv/bin/depth-pose bank build -o "$folder/bank.npz" --poses 10 --workers 0
    .venv/bin/depth-pose run "$folder/in.mcap" -o "$folder/out.mcap" --bank "$folder/bank.npz"
)
