#!/usr/bin/env bash
# Every table of docs/results.md, as Markdown on stdout; pictures and JSON go to OUT.
#
#   bench/results.sh SCENES ASSETS OUT [PYTHON] [LPIPS]
#
# SCENES holds the development scenes in their original formats, ASSETS the scanned objects (see `surfelsplat synth
# --help`), PYTHON has numpy and opencv-python-headless (default python3; without OpenCV the peer's rows are left out),
# LPIPS is the file of docs/lpips.md (without it that column is left out).
# About ten minutes on two cores.
set -euo pipefail
cd "$(dirname "$0")/.."
scenes=$1
assets=$2
out=$3
python=${4:-python3}
lpips=(${5:+--lpips "$5"})
tool=target/release/surfelsplat
mkdir -p "$out"
cargo build --release --quiet

# A report's title becomes a section, its tables subsections; pictures and the long table behind one stay in OUT, and
# where things lie on this machine is nobody's business.
section() {
    printf '\n## %s\n' "$1"
    sed -e '/^## Counts per bin/,/^!\[/d' -e '/^!\[/d' -e 's/^## /#### /' -e '/^# /d' \
        -e "s|$scenes/||g" -e "s|$out|OUT|g" | cat -s
}

printf '## Development scenes\n'
bench/scenes.sh "$scenes" "$out/scenes" "$python"
bench/synth.sh "$assets" "$out/synth" "$python" 0..10 | section 'Rendered scenes of objects never trained on'
bench/synth.sh "$assets" "$out/synth640" "$python" 0..10 640x512 | sed '/^## Depth and normals per scene/,$d' |
    section 'The same at 640x512'
"$tool" --quiet eval ablation --assets "$assets" --split val --seeds 0..10 -o "$out/ablation" | section 'Ablation'
for method in matching network; do
    result=$out/scenes/dtu_23_24.$method
    "$tool" --quiet eval dtu "$result" --scenes "$scenes/dtu_scan24" --scan 24 -o "$out/dtu.$method" |
        section "DTU protocol, one scan, $method"
    "$tool" --quiet eval nvs "$scenes/dtu_scan24" "$result" --targets 22,31,33 --size 320x256 "${lpips[@]}" -o "$out/nvs.$method" |
        section "New views, $method"
    "$tool" --quiet eval nyquist "$scenes/dtu_scan24" --views 23,24 --method "$method" -o "$out/nyquist.$method" |
        section "Nyquist criterion, $method"
    "$tool" --quiet eval efficiency "$scenes/dtu_scan24" --views 23,24 --method "$method" -o "$out/time.$method" |
        section "Time, $method"
done
