#!/usr/bin/env bash
# Unpacks what pack.sh made, checks the card against the CPU, and trains.
#
#   run.sh PARTS OUT [SECONDS]
#
# PARTS is the folder of parts, OUT gets check.txt, train.log, metrics.jsonl and the run's checkpoint and weights in
# parts of at most 15 MiB: `cat checkpoint.safetensors.* > checkpoint.safetensors` joins them. OUT/resume.* (such parts
# of an earlier checkpoint, put there before) are gone on with. Training ends after SECONDS (default 480) or with its
# configuration. CONFIG stands for the one packed; DEVICE (default cuda) is as in `surfelsplat train --device`; WORK is
# where things are unpacked.
#
# Needs the driver and, for cuda, NVRTC and the headers of the CUDA runtime: CUDA_PATH, or where they usually are.
set -euo pipefail
parts=$(realpath "$1")
mkdir -p "$2"
out=$(realpath "$2")
seconds=${3:-480}
device=${DEVICE:-cuda}
config=${CONFIG:+$(realpath "$CONFIG")}
work=${WORK:-$(mktemp -d)}

(cd "$parts" && sha256sum --check --quiet SHA256SUMS)
mkdir -p "$work"
cat "$parts"/program.tar.xz.* | tar -C "$work" -xJ
cat "$parts"/data.tar.xz.* | tar -C "$work" -xJ

if [ "${device%%:*}" = cuda ]; then
    # The headers first, then the libraries, which the program opens by name.
    find_first() { find / -xdev -name "$1" -not -path '/proc/*' 2>/dev/null | head -1; }
    if [ -z "${CUDA_PATH:-}" ]; then
        header=$([ -e /usr/local/cuda/include/cuda_runtime.h ] && echo /usr/local/cuda/include/cuda_runtime.h ||
            find_first cuda_runtime.h)
        if [ -z "$header" ]; then
            echo "run.sh: cuda_runtime.h is nowhere; set CUDA_PATH to the folder that holds include/" >&2
            exit 1
        fi
        CUDA_PATH=$(dirname "$(dirname "$header")")
    fi
    nvrtc=$(find -L "$CUDA_PATH" -name 'libnvrtc.so*' 2>/dev/null | head -1)
    nvrtc=${nvrtc:-$(find_first 'libnvrtc.so*')}
    export CUDA_PATH LD_LIBRARY_PATH="$(dirname "${nvrtc:-/usr/lib/libnvrtc.so}"):${LD_LIBRARY_PATH:-}"
    # The programs look for the unversioned name.
    if [ -n "$nvrtc" ] && [ ! -e "$(dirname "$nvrtc")/libnvrtc.so" ]; then
        mkdir -p "$work/lib"
        ln -sf "$nvrtc" "$work/lib/libnvrtc.so"
        export LD_LIBRARY_PATH="$work/lib:$LD_LIBRARY_PATH"
    fi
    echo "CUDA_PATH=$CUDA_PATH nvrtc=$nvrtc"
fi

cd "$work"
# Kernels are compiled and compared once, not once a program.
printf '[compilation]\ncache = true\n[autotune]\nlevel = "minimal"\n' >cubecl.toml
# Says what differs and goes on: whoever reads it decides whether the training counts.
timeout "${CHECK_SECONDS:-180}" ./surfelsplat device --device "$device" | tee "$out/check.txt" ||
    echo "run.sh: the check of $device failed; see check.txt" >&2

mkdir -p run
if ls "$out"/resume.* >/dev/null 2>&1; then cat "$out"/resume.* >run/checkpoint.safetensors; fi
initial=()
if [ -e initial.safetensors ]; then initial=(--initial initial.safetensors); fi
mkdir -p samples
timeout --signal=INT "$seconds" ./surfelsplat train "${config:-config.toml}" --device "$device" --assets assets --cache samples \
    -o run "${initial[@]}" 2> >(tee "$out/train.log" >&2) && code=0 || code=$?

for file in checkpoint last best; do
    if [ -e "run/$file.safetensors" ]; then
        rm -f "$out/$file.safetensors".*
        split -b 15M -d "run/$file.safetensors" "$out/$file.safetensors."
    fi
done
cp run/metrics.jsonl "$out/" 2>/dev/null || true
ls -la "$out"
# 124: the time was up, which is how training usually ends here.
if [ "$code" != 0 ] && [ "$code" != 124 ]; then
    echo "run.sh: training failed with code $code" >&2
    exit "$code"
fi
