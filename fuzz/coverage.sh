#!/usr/bin/env bash
# Which lines of core the seeds reach (with `corpus`: also what fuzzing on this machine has found, in corpus/), on stable Rust: the
# stable test that replays them, built with counters. Needs llvm-profdata and llvm-cov of rustc's LLVM version, from the rustup
# component llvm-tools or a package (Debian: llvm-22 for Rust 1.95).
# Prints a table per file; the lines themselves are then in target/fuzz-coverage/lines.txt.
set -euo pipefail
cd "$(dirname "$0")/.."
version=$(rustc -vV | sed -n 's/^LLVM version: \([0-9]*\).*/\1/p')
bundled=$(rustc --print sysroot)/lib/rustlib/$(rustc -vV | sed -n 's/^host: //p')/bin
tool() {
    for found in "$bundled/$1" "$(command -v "$1-$version" || true)"; do
        if [ -x "$found" ]; then echo "$found"; return; fi
    done
    echo "$1 $version is missing: rustup component add llvm-tools, or apt-get install llvm-$version" >&2
    return 1
}
profdata=$(tool llvm-profdata)
cov=$(tool llvm-cov)
out=$PWD/target/fuzz-coverage
rm -rf "$out/profiles"
mkdir -p "$out/profiles"
if [ "${1:-}" = corpus ]; then export GANTRY_TAU_REPLAY_CORPUS=1; fi
# Build scripts and macros are counted too, into a file that is not evaluated.
export LLVM_PROFILE_FILE=$out/built.profraw
export RUSTFLAGS="-C instrument-coverage" CARGO_TARGET_DIR=$out CARGO_TERM_COLOR=never
binary=$(cargo test -q --locked -p gantry-tau-tests --test it --no-run --message-format=json |
    sed -n 's/.*"executable":"\([^"]*it-[^"]*\)".*/\1/p')
LLVM_PROFILE_FILE="$out/profiles/seeds.profraw" "$binary" --exact fuzz_seeds::every_seed_holds > "$out/replayed.txt"
"$profdata" merge -sparse "$out"/profiles/*.profraw -o "$out/merged.profdata"
core=(-instr-profile="$out/merged.profdata" "$binary" -ignore-filename-regex='/(proofs|host|tests)/|\.cargo/|/rustc/|/tests\.rs$')
"$cov" show "${core[@]}" -show-instantiations=false -use-color=false > "$out/lines.txt"
"$cov" report "${core[@]}" |
    awk '$1 ~ /\.rs$/ || $1 == "TOTAL" { printf "%-44s %5d lines, %4d not reached, %s\n", $1, $8, $9, $10 }'
