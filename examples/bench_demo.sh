#!/usr/bin/env bash
# Starts an emulated bench and uses it as one would a real one: home, jog, scan, recognise. Needs no hardware.
# `make bench-demo` runs it; RIG names the command where it is not on the path.
set -euo pipefail
rig=${RIG:-rig}
here=$(dirname "$0")
work=$(mktemp -d -t rig-bench-demo.XXXXXX)
# Not among the latches and homing notes of benches that are really there.
mkdir -m 700 "$work/runtime"
export RIG_RUNTIME_DIR=$work/runtime

end() {
    kill "$emulator" 2>/dev/null || true
    wait "$emulator" 2>/dev/null || true
    rm -rf "$work"
}

step() { printf '\n== %s\n' "$*"; }
show() { printf '$ rig %s\n' "$*"; "$rig" "$@"; }

step "starting the emulated bench: a GRBL controller, two Dynamixel servos and a camera"
"$rig" emulate "$here/bench_emulated.yaml" --bench-out "$work/bench.yaml" --seed 2 &
emulator=$!
trap end EXIT
while [ ! -s "$work/bench.yaml" ]; do
    kill -0 "$emulator"  # ends here if the emulator has failed
    sleep 0.2
done

step "homing it; its pan stands at 0"
show home "$work/bench.yaml" --theta-deg 0
step "jogging"
show move "$work/bench.yaml" --by --x-mm -50 --z-mm -20
step "scanning 3 x 3 x 1 places at 3 pans each"
show scan "$here/scan_emulated.yaml" --bench "$work/bench.yaml" --out "$work/grid"
step "recognising the building before it, live"
show recognise "$work/bench.yaml" --models architecture --start 201,161,121,0 --out "$work/run-live"
step "recognising on the pictures of the scan instead"
show recognise "$here/mock_emulated.yaml" --grid "$work/grid" --models architecture --start 201,161,121,0 \
    --out "$work/run-mock"
step "done: the emulated bench was homed, jogged, scanned with, and recognised on"
