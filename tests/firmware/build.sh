#!/usr/bin/env bash
# Builds the firmware for one processor: build.sh m7|m4f [arguments of cargo build]. Says which toolchain it took; the last line is
# the folder of the images. Exit code 3: something is missing, which a line that begins with SKIPPED names.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
# A test is run by cargo, whose settings are for the host.
unset RUSTUP_TOOLCHAIN RUSTC CARGO RUSTFLAGS CARGO_ENCODED_RUSTFLAGS CARGO_BUILD_TARGET LD_LIBRARY_PATH
# Without it defmt leaves every message out.
export DEFMT_LOG=info
target=thumbv7em-none-eabihf

skip() { printf 'SKIPPED: %s\n' "$*"; exit 3; }

case ${1:-} in
    m7) cpu=cortex-m7 ;;
    m4f) cpu=cortex-m4 ;;
    *) echo "usage: build.sh m7|m4f [arguments of cargo build]" >&2; exit 2 ;;
esac
folder=${GANTRY_TAU_FIRMWARE_TARGET:-$here/target}/$1
shift

# Rust 1.85 from ../shared/toolchain, whose sources let core be built for any target; as .ci/run unpacks it.
rust185() {
    local archive=$root/../shared/toolchain/rust-1.85.0-dev.tar.xz toolchain=${TMPDIR:-/tmp}/gantry-tau-rust185
    if ! rustc +rust185 --version >/dev/null 2>&1; then
        [ -f "$archive" ] || skip "neither rustup's target $target is installed (rustup target add $target) nor is ../shared/toolchain/rust-1.85.0-dev.tar.xz there"
        if [ ! -x "$toolchain/tc/bin/rustc" ]; then
            mkdir -p "$toolchain"
            tar xf "$archive" -C "$toolchain"
        fi
        rustup toolchain link rust185 "$toolchain/tc"
        rustc +rust185 --version >/dev/null || skip "rust185 does not run: ../shared/toolchain/README.md names the libraries it needs"
    fi
    [ -d "$(rustc +rust185 --print sysroot)/lib/rustlib/src" ] || skip "the toolchain rust185 is without the sources of the standard library"
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
    how=(cargo)
    standard=()
    said="$(rustc --version), its library for $target"
else
    rust185
    rust_lld=$(linker)
    [ -n "$rust_lld" ] || skip "no installed toolchain has rust-lld"
    export CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER=$rust_lld RUSTC_BOOTSTRAP=1
    how=(cargo +rust185)
    standard=(-Zbuild-std=core)
    said="$(rustc +rust185 --version), core built from its sources"
fi
echo "firmware for $cpu: $said"
cd "$here"
"${how[@]}" build --release --locked --quiet "${standard[@]}" --target $target --target-dir "$folder" "$@"
echo "$folder/$target/release"
