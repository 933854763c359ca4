# Sourced by the launch scripts after the set-up: ensure_bank builds the default exemplar bank
# where it is missing, or was built by other sources than these.

ensure_bank() {
    local bank building key
    bank=$(.venv/bin/python -c 'from depth_pose.bank import default_bank_path; print(default_bank_path())')
    key=$(find src/depth_pose/bank src/depth_pose/body src/depth_pose/*.py -name '*.py' ! -name cli.py \
        | LC_ALL=C sort | xargs sha256sum | sha256sum | cut -c 1-16)
    if [ -f "$bank" ] && [ "$(cat "$bank.sources" 2>/dev/null)" = "$key" ]; then return; fi
    say "Building the default exemplar bank (once) into $bank"
    mkdir -p "$(dirname "$bank")"
    building=${bank%.npz}.$$.npz # whoever reads the bank meanwhile sees the old one, or the whole new one
    if ! .venv/bin/depth-pose bank build -o "$building"; then
        rm -f "$building"
        fail "The bank could not be built; the reason stands above."
    fi
    mv "$building" "$bank"
    echo "$key" >"$bank.sources"
    say "bank: done"
}
