#!/usr/bin/env bash
# Reconstructs and scores the development scenes and the same pairs with OpenCV's StereoSGBM, all by one ruler.
#
#   bench/scenes.sh SCENES OUT [PYTHON]
#
# SCENES holds dtu_scan24, strecha_fountain_p11, hololens_000, redwood_rgbd5, ...; OUT receives the results;
# PYTHON has numpy and opencv-python-headless (default python3; without OpenCV the peer's rows are left out).
set -euo pipefail
cd "$(dirname "$0")/.."
scenes=$1
out=$2
python=${3:-python3}
tool=target/release/surfelsplat
cargo build --release --quiet

# name, scene, views, size
score() {
    local name=$1 scene=$scenes/$2 views=$3 size=$4 peer=$out/$1.sgbm ours
    printf '\n### %s: views %s at %s\n' "$2" "$views" "$size"
    for method in matching network; do
        ours=$out/$name.$method
        "$tool" --quiet reconstruct "$scene" --views "$views" --size "$size" --depth "$method" -o "$ours"
        printf '\n%s, %s\n\n' "$method" "$(times "$ours")"
        "$tool" eval depth "$scene" "$ours" | grep '^|'
    done
    if "$python" bench/peers/opencv_sgbm.py "$scene" "$peer" --cameras "$ours/cameras.json" \
        --pair "${views%,*}" "${views#*,}" --size "${size%x*}" "${size#*x}" >"$out/$name.log" 2>&1; then
        printf '\nStereoSGBM, same photographs, cameras, size and range\n\n'
        "$tool" eval depth "$scene" "$peer" | grep '^|'
    else
        printf '\nStereoSGBM: %s\n' "$(tail -n 1 "$out/$name.log")"
    fi
}

# total, stages and memory of a reconstruction
times() {
    "$python" - "$1/report.json" <<'PY'
import json, sys
report = json.load(open(sys.argv[1]))
stages = ", ".join(f"{t['stage']} {t['ms'] / 1e3:.2f}" for t in report["timings"])
print(f"{report['total_ms'] / 1e3:.2f} s ({stages}), peak {report['peak_memory_mib']:.0f} MiB, {report['threads']} threads")
PY
}

mkdir -p "$out"
score dtu_23_24 dtu_scan24 23,24 320x256
score dtu_43_42 dtu_scan24 43,42 320x256
score dtu_23_24_640 dtu_scan24 23,24 640x512
score dtu_43_42_640 dtu_scan24 43,42 640x512
score fountain_4_5 strecha_fountain_p11 0004,0005 384x256
score fountain_7_8 strecha_fountain_p11 0007,0008 384x256
score fountain_4_5_768 strecha_fountain_p11 0004,0005 768x512
score hololens_105_108 hololens_000 00105,00108 384x256
score redwood_0_4 redwood_rgbd5 00000,00004 320x240
score redwood_0_4_640 redwood_rgbd5 00000,00004 640x480

printf '\n### Whole scenes without a flag\n\n| scene | views | seconds | peak MiB | triangles |\n|---|---|---|---|---|\n'
for scene in dtu_scan24 strecha_fountain_p11 sceaux_castle ngp_fox hololens_000 robustmvd_table redwood_rgbd5 middlebury_temple_sparse_ring; do
    "$tool" --quiet reconstruct "$scenes/$scene" -o "$out/$scene"
    "$python" - "$out/$scene/report.json" "$scene" <<'PY'
import json, sys
r = json.load(open(sys.argv[1]))
views = ", ".join(v["stem"] for v in r["views"])
print(f"| {sys.argv[2]} | {views} | {r['total_ms'] / 1e3:.1f} | {r['peak_memory_mib']:.0f} | {r['mesh']['triangles']} |")
PY
done
