#!/usr/bin/env bash
# Builds the program for graphics cards and packs it with what training needs, for a machine that has a card but
# neither a compiler nor a network.
#
#   gpu/pack.sh OUT ASSETS [CONFIG] [INITIAL]
#
# OUT gets program.tar.xz.* and data.tar.xz.* (parts of at most PART, default 56M), run.sh and SHA256SUMS. ASSETS holds
# the scanned objects; CONFIG defaults to crates/surfel-train/configs/small_stage1.toml; INITIAL are weights to start from.
# SAMPLES=DIR packs a folder of samples made ahead (`surfelsplat train --prepare --cache DIR`), which spares the card's
# time. FEATURES (default cuda,vulkan) says what is built, TARGET where.
set -euo pipefail
cd "$(dirname "$0")/.."
out=$1
assets=$2
config=${3:-crates/surfel-train/configs/small_stage1.toml}
initial=${4:-}
features=${FEATURES-cuda,vulkan}
part=${PART:-56M}
export CARGO_TARGET_DIR=${TARGET:-target/gpu}

cargo build --release --package surfelsplat ${features:+--features "$features"}

stage=$(mktemp -d)
trap 'rm -rf "$stage"' EXIT
cp "$CARGO_TARGET_DIR/release/surfelsplat" "$stage/"
strip "$stage/surfelsplat"
cp LICENSE-* "$stage/"

mkdir -p "$out"
rm -f "$out"/program.tar.xz.* "$out"/data.tar.xz.* "$out/SHA256SUMS"
tar -C "$stage" -c . | xz -T0 -6 | split -b "$part" -d - "$out/program.tar.xz."
cp "$config" "$stage/config.toml"
what=(config.toml assets)
if [ -n "$initial" ]; then
    cp "$initial" "$stage/initial.safetensors"
    what+=(initial.safetensors)
fi
ln -s "$(realpath "$assets")" "$stage/assets"
if [ -n "${SAMPLES:-}" ]; then
    ln -s "$(realpath "$SAMPLES")" "$stage/samples"
    what+=(samples)
fi
# Scans and photographs are compressed already; what is left to win needs no effort.
tar -C "$stage" -ch "${what[@]}" | xz -T0 -1 | split -b "$part" -d - "$out/data.tar.xz."
cp gpu/run.sh "$out/"
(cd "$out" && sha256sum run.sh program.tar.xz.* data.tar.xz.* >SHA256SUMS)

# A program needs a C library at least as new as the newest of whose functions it calls.
objdump -T "$stage/surfelsplat" | grep -o 'GLIBC_[0-9.]*' | sort -uV | tail -1 | sed 's/^/needs /'
du -ch "$out"/program.tar.xz.* "$out"/data.tar.xz.* | tail -1
