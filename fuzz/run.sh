#!/usr/bin/env bash
# Runs one target for so many seconds, from its seeds and what was found before, with its dictionary if it has one.
set -euo pipefail
cd "$(dirname "$0")"
target=$1
seconds=$2
mkdir -p "corpus/$target"
dictionary=()
[ -f "dictionaries/$target.dict" ] && dictionary=(-dict="dictionaries/$target.dict")
cargo +nightly fuzz run "$target" "corpus/$target" "seeds/$target" -- \
    ${dictionary[@]+"${dictionary[@]}"} -max_total_time="$seconds" -max_len=16384 -timeout=20
