#!/usr/bin/env bash
# Builds the firmware for one processor: build.sh m7|m7-small|m7-keyed|m7-small-keyed|m4f [arguments of cargo build]. Says which toolchain it took; the last line is
# the folder of the images. `build.sh check` only says which it would take.
# Exit code 3: something is missing, which a line that begins with SKIPPED names.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
# A test is run by cargo, whose settings are for the host.
unset RUSTUP_TOOLCHAIN RUSTC CARGO RUSTFLAGS CARGO_ENCODED_RUSTFLAGS CARGO_BUILD_TARGET LD_LIBRARY_PATH
# Without it defmt leaves every message out.
export DEFMT_LOG=info
target=thumbv7em-none-eabihf

skip() { printf 'SKIPPED: %s\n' "$*"; exit 3; }

what=${1:-}
profile=release
features=()
case $what in
    check | m7) cpu=cortex-m7 ;;
    m7-small) cpu=cortex-m7 profile=small ;;
    m7-keyed) cpu=cortex-m7 features=(--features keyed) ;;
    m7-small-keyed) cpu=cortex-m7 profile=small features=(--features keyed) ;;
    m4f) cpu=cortex-m4 ;;
    *) echo "usage: build.sh check|m7|m7-small|m7-keyed|m7-small-keyed|m4f [arguments of cargo build]" >&2; exit 2 ;;
esac
folder=${GANTRY_TAU_FIRMWARE_TARGET:-$here/target}/$what
shift

# Rust 1.85 from ../shared/toolchain, whose sources let core be built for any target; unpacked where .ci/run unpacks it.
rust185=${TMPDIR:-/tmp}/gantry-tau-rust185
unpack() {
    local archive=$root/../shared/toolchain/rust-1.85.0-dev.tar.xz
    if [ ! -x "$rust185/tc/bin/rustc" ]; then
        [ -f "$archive" ] || skip "neither rustup's target $target is installed (rustup target add $target) nor is ../shared/toolchain/rust-1.85.0-dev.tar.xz there"
        mkdir -p "$rust185"
        tar xf "$archive" -C "$rust185"
    fi
    "$rust185/tc/bin/rustc" --version >/dev/null || skip "$rust185/tc/bin/rustc does not run: ../shared/toolchain/README.md names the libraries it needs"
}

# The linker of any installed toolchain: rust185 has none.
linker() {
    local host toolchain path
    host=$(rustc -vV | sed -n 's/^host: //p')
    for toolchain in $(rustup toolchain list | cut -d' ' -f1); do
        path=$(rustc "+$toolchain" --print sysroot)/lib/rustlib/$host/bin/rust-lld
        if [ -x "$path" ]; then echo "$path"; return; fi
    done
}

export CARGO_TARGET_THUMBV7EM_NONE_EABIHF_RUSTFLAGS="-C target-cpu=$cpu"
if [ -d "$(rustc --print target-libdir --target $target)" ]; then
    cargo=cargo
    standard=()
    said="$(rustc --version), its library for $target"
else
    unpack
    rust_lld=$(linker)
    [ -n "$rust_lld" ] || skip "no installed toolchain has rust-lld"
    export CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER=$rust_lld RUSTC_BOOTSTRAP=1 RUSTC=$rust185/tc/bin/rustc
    cargo=$rust185/tc/bin/cargo
    standard=(-Zbuild-std=core)
    said="$("$RUSTC" --version), core built from its sources"
fi
echo "firmware for $cpu: $said"
if [ "$what" = check ]; then exit; fi
cd "$here"
"$cargo" build --profile "$profile" --locked --quiet "${standard[@]}" --target $target --target-dir "$folder" "${features[@]}" "$@"
echo "$folder/$target/$profile"
