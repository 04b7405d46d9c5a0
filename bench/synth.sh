#!/usr/bin/env bash
# Rendered scenes with exact surfaces: our methods and OpenCV's StereoSGBM, scored by one ruler in one run.
#
#   bench/synth.sh ASSETS OUT [PYTHON] [SEEDS] [SIZE]
#
# ASSETS is a folder of scanned objects (see `surfelsplat synth --help`); OUT receives the scenes, the peer's depth
# maps and the report; PYTHON has numpy and opencv-python-headless (default python3). SEEDS defaults to 0..10, SIZE to
# 320x256. The peer gets the depth range that ours found.
set -euo pipefail
cd "$(dirname "$0")/.."
assets=$1
out=$2
python=${3:-python3}
seeds=${4:-0..10}
size=${5:-320x256}
tool=target/release/surfelsplat
cargo build --release --quiet

"$tool" --quiet synth export --assets "$assets" --split val --seeds "$seeds" --size "$size" -o "$out/scenes"
for scene in "$out"/scenes/*/; do
    name=$(basename "$scene")
    "$tool" --quiet reconstruct "$scene" --views 00,01 --size "$size" -o "$out/ours/$name"
    "$python" bench/peers/opencv_sgbm.py "$scene" "$out/sgbm/$name" --cameras "$out/ours/$name/cameras.json" \
        --pair 00 01 --size "${size%x*}" "${size#*x}" >"$out/sgbm.log" 2>&1 || { cat "$out/sgbm.log" >&2; exit 1; }
done
"$tool" eval synth --assets "$assets" --split val --seeds "$seeds" --size "$size" --method exact,matching,network \
    --result "StereoSGBM=$out/sgbm" -o "$out/report"
