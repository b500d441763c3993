#!/usr/bin/env bash
# Parity and benchmarks on the graphics card of this machine, in a few minutes: `bench/on-a-card.sh [FILE]`.
# Writes one file (default on-a-card.txt): card and driver, the parity tests, GPU against CPU by pass and size, remeshing, and frames written to disk.
# Ends with status 1 if any part failed. INSONIFY_ADAPTER picks a card. INSONIFY_BIN and INSONIFY_TESTS name binaries built elsewhere (`insonify`,
# and the unit tests of insonify-imaging, which hold the parity tests), for a machine without a Rust toolchain.
set -euo pipefail
out=$(realpath -m "${1:-on-a-card.txt}")
cd "$(dirname "$0")/.."
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

if [ -z "${INSONIFY_BIN:-}" ]; then
    cargo build --release --locked
    INSONIFY_BIN=$PWD/target/release/insonify
fi
tests() {
    if [ -n "${INSONIFY_TESTS:-}" ]; then "$INSONIFY_TESTS" "$@"; else cargo test --release --locked -p insonify-imaging --lib -- "$@"; fi
}
# Nothing is measured where no adapter is found.
"$INSONIFY_BIN" render --backend gpu -o "$work/first.png"
section() { printf '\n== %s (%s)\n' "$1" "$(date -u +%H:%M:%S)"; }

{
    failed=0
    section "machine, $(date -u +%F)"
    "$INSONIFY_BIN" doctor || failed=1
    if command -v nvidia-smi > /dev/null; then nvidia-smi --query-gpu=name,driver_version,memory.total --format=csv || true; fi

    section "parity"
    INSONIFY_REQUIRE_GPU=1 tests parity_tests:: 2>&1 | tail -n 15 || failed=1

    section "frames: the default scene, and one whose mesh moves in every frame"
    "$INSONIFY_BIN" bench --frames 200 || failed=1
    "$INSONIFY_BIN" scene > "$work/moving.toml" || failed=1
    cat >> "$work/moving.toml" << 'SCENE'
[deform]
nodes = 5000
ramp_s = 3.0
field = { kind = "indentation", centre_mm = [-68.1, -77.2, -46.3], direction = [0.148, 0.962, 0.229], depth_mm = 12.0, radius_mm = 40.0 }
SCENE
    "$INSONIFY_BIN" bench "$work/moving.toml" --frames 200 || failed=1

    section "the size of raysim's published benchmark"
    "$INSONIFY_BIN" bench bench/raysim-size.toml --frames 100 || failed=1

    section "GPU against CPU: passes, sizes, effects, transfers, remeshing"
    "$INSONIFY_BIN" bench --compare || failed=1

    section "the dense inverse, 300 moves"
    "$INSONIFY_BIN" tradeoff remesh --updates 300 --time-limit-s 20 || failed=1

    section "frames written to a folder"
    time "$INSONIFY_BIN" render --backend gpu --frames 300 -o "$work/frames" || failed=1
    exit $failed
} 2>&1 | tee "$out"
