# Sourced by the launch scripts after the set-up: ensure_bank builds the default exemplar bank
# where it is missing, or where these scripts built it from other sources than today's. A bank that
# somebody else put there is left alone.

ensure_bank() {
    local bank building sources
    if [ -n "${DEPTH_POSE_BANK:-}" ]; then return; fi
    bank=$(.venv/bin/python -c 'from depth_pose.bank import default_bank_path; print(default_bank_path())')
    sources=$(find src/depth_pose/{bank,body,motion} src/depth_pose/core/{skeleton,rotations}.py \( -name '*.py' -o -name '*.npz' \) \
        | LC_ALL=C sort | xargs sha256sum | sha256sum | cut -c 1-16)
    if [ -f "$bank" ]; then
        # beside a bank of ours: its checksum and its sources
        read -r built_bank built_sources 2>/dev/null <"$bank.built" || return 0
        if [ "$built_sources" = "$sources" ]; then return; fi
        if [ "$built_bank" != "$(sha256sum <"$bank" | cut -c 1-16)" ]; then return; fi
    fi
    say "Building the default exemplar bank (once) into $bank"
    mkdir -p "$(dirname "$bank")"
    building=${bank%.npz}.$$.npz # whoever reads the bank meanwhile sees the old one, or the whole new one
    if ! .venv/bin/depth-pose bank build -o "$building"; then
        rm -f "$building"
        fail "The bank could not be built; the reason stands above."
    fi
    mv "$building" "$bank"
    echo "$(sha256sum <"$bank" | cut -c 1-16) $sources" >"$bank.built"
    say "bank: done"
}
