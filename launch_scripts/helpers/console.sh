# Sourced by the launch scripts: short messages with the time since the first of them began.

if [ -t 1 ]; then on_terminal=1; else on_terminal=; fi
: "${DEPTH_POSE_BEGAN:=$(date +%s)}" # one clock for scripts that call each other
export DEPTH_POSE_BEGAN

elapsed() { echo $(($(date +%s) - DEPTH_POSE_BEGAN)); }

# say TEXT: one line, with the seconds since the beginning.
say() { printf '[%3d s] %s\n' "$(elapsed)" "$*"; }

# fail TEXT...: the lines, on stderr, and the end.
fail() {
    printf '%s\n' "$@" >&2
    exit 1
}

# run_jobs LOGS: wait for the jobs in job_pids (name -> pid), which write LOGS/NAME.log.
# Says what each took; shows the newest line of a log while waiting on a terminal.
declare -A job_pids=()
run_jobs() {
    local logs=$1 name line began=$SECONDS failed=
    while [ ${#job_pids[@]} -gt 0 ]; do
        for name in "${!job_pids[@]}"; do
            if kill -0 "${job_pids[$name]}" 2>/dev/null; then
                if [ -n "$on_terminal" ]; then
                    line=$(tail -n 1 "$logs/$name.log" 2>/dev/null | tr -d '\r' | cut -c 1-60)
                    printf '\r\033[K[%3d s] %s: %s' "$(elapsed)" "$name" "$line"
                fi
                continue
            fi
            if [ -n "$on_terminal" ]; then printf '\r\033[K'; fi
            if wait "${job_pids[$name]}"; then
                say "$name: done in $((SECONDS - began)) s"
            else
                failed="$failed $name"
            fi
            unset "job_pids[$name]"
        done
        sleep 0.2
    done
    for name in $failed; do
        printf '\n%s failed; the end of %s:\n' "$name" "$logs/$name.log" >&2
        tail -n 25 "$logs/$name.log" >&2
    done
    if [ -n "$failed" ]; then exit 1; fi
}
