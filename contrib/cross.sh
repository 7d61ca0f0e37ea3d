#!/usr/bin/env bash
# Builds outrigger for a 64-bit Raspberry Pi (aarch64, Debian 12 or newer) on an x86-64 machine.
#
#   contrib/cross.sh [CARGO ARGUMENTS]      default: build --release --bin outrigger
#   contrib/cross.sh build --profile dev
#   contrib/cross.sh run --release -- demo  runs the binary under qemu's user-mode emulation
#
# The compiler's standard library for aarch64 comes from rustup where rustup can fetch it. Failing that (or
# with CROSS_FROM=debian), Debian 12's rustc-web and its arm64 library are unpacked below target/cross:
# nothing is installed, no foreign architecture is added. CROSS_FROM=rustup forbids that way.
#
# Everything made lies in target/cross and is kept: a second run builds only what changed. The binary is
# target/cross/aarch64-unknown-linux-gnu/release/outrigger.
set -euo pipefail

TARGET=aarch64-unknown-linux-gnu
FROM=${CROSS_FROM:-auto}
cd "$(dirname "$0")/.."
W=$PWD/target/cross

fail() {
    echo "cross.sh: $1" >&2
    exit 1
}

# What the host must have: a linker, the C library to link with, and a C++ compiler (for Clipper). Installing is left to the user.
need_linker() {
    local missing=()
    command -v aarch64-linux-gnu-gcc >/dev/null || missing+=(gcc-aarch64-linux-gnu)
    command -v aarch64-linux-gnu-g++ >/dev/null || missing+=(g++-aarch64-linux-gnu)
    [ -e /usr/aarch64-linux-gnu/lib/crt1.o ] || missing+=(libc6-dev-arm64-cross)
    if [ "$1" = run ]; then
        command -v qemu-aarch64-static >/dev/null || missing+=(qemu-user-static)
    fi
    [ ${#missing[@]} = 0 ] || fail "these packages are missing; as root: apt-get install --no-install-recommends ${missing[*]}"
}

# True when rustup has the target, or can fetch it.
from_rustup() {
    command -v rustup >/dev/null || return 1
    rustup target list --installed 2>/dev/null | grep -qx "$TARGET" && return 0
    # A dead link must not hang the build: the library is about 30 MB.
    timeout 300 rustup target add "$TARGET"
}

# Unpacks Debian's compiler (amd64) and its arm64 standard library to $W/rw, with an apt of our own that
# knows both architectures; the system's is not touched. Sets RUSTC.
from_debian() {
    [ "$(dpkg --print-architecture 2>/dev/null)" = amd64 ] || fail "Debian's compiler needs Debian on x86-64; use rustup instead: rustup target add $TARGET"
    export RUSTC=$W/rw/bin/rustc
    if "$RUSTC" --print target-libdir --target "$TARGET" >/dev/null 2>&1 && [ -e "$W/rw/complete" ]; then
        return
    fi
    rm -rf "$W/rw" "$W/deb"
    mkdir -p "$W/apt/state/lists/partial" "$W/apt/cache/archives/partial" "$W/deb" "$W/rw/bin"
    : >"$W/apt/state/status"
    cat >"$W/apt/apt.conf" <<CONF
Dir::State "$W/apt/state";
Dir::State::status "$W/apt/state/status";
Dir::Cache "$W/apt/cache";
APT::Architecture "amd64";
APT::Architectures { "amd64"; "arm64"; };
APT::Sandbox::User "root";
CONF
    (
        export APT_CONFIG=$W/apt/apt.conf
        apt-get update || fail "apt-get update failed: is there a link to Debian's mirror?"
        # The newest rustc-web names the library that belongs to it, and that one its LLVM.
        local version series llvm
        version=$(apt-cache policy rustc-web | sed -n 's/^ *Candidate: //p')
        case $version in
        '' | '(none)') fail "this Debian has no rustc-web: it is in Debian 12 (bookworm) and its security updates" ;;
        esac
        series=$(cut -d. -f1,2 <<<"$version")
        llvm=$(apt-cache show "libstd-rust-web-$series:amd64=$version" | grep -o 'libllvm[0-9]*' | sort -u | tail -1)
        [ -n "$llvm" ] || fail "libstd-rust-web-$series names no libllvm"
        cd "$W/deb"
        apt-get download "rustc-web:amd64=$version" "libstd-rust-web-$series:amd64=$version" \
            "libstd-rust-web-dev:amd64=$version" "libstd-rust-web-dev:arm64=$version" "$llvm:amd64" ||
            fail "Debian's compiler could not be fetched"
        for deb in *.deb; do dpkg -x "$deb" "$W/rw"; done
    )
    # The compiler finds its own libraries only through the path: it was not installed.
    printf '#!/bin/sh\nLD_LIBRARY_PATH=%q exec %q "$@"\n' "$W/rw/usr/lib/x86_64-linux-gnu" "$W/rw/usr/bin/rustc" >"$RUSTC"
    chmod +x "$RUSTC"
    "$RUSTC" --version || fail "the unpacked compiler does not run"
    touch "$W/rw/complete"
}

[ $# -gt 0 ] || set -- build --release --bin outrigger
command -v cargo >/dev/null || fail "no cargo in the path: install Rust (https://rustup.rs)"
need_linker "$1"
case $FROM in
auto) from_rustup || from_debian ;;
rustup) from_rustup || fail "rustup has no $TARGET and could not fetch it" ;;
debian) from_debian ;;
*) fail "CROSS_FROM is auto, rustup or debian, not '$FROM'" ;;
esac

# Per target, so that build scripts still compile for this machine.
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER="qemu-aarch64-static -L /usr/aarch64-linux-gnu"
export CC_aarch64_unknown_linux_gnu=aarch64-linux-gnu-gcc CXX_aarch64_unknown_linux_gnu=aarch64-linux-gnu-g++
# Products and sums are not fused, so that Clipper's offsets have the same bits as on x86-64.
export CXXFLAGS_aarch64_unknown_linux_gnu=-ffp-contract=off
export AR_aarch64_unknown_linux_gnu=aarch64-linux-gnu-ar
verb=$1
shift
# nice: a cross build takes tens of minutes of processor time on a small machine.
exec nice -n 15 cargo "$verb" --locked --target "$TARGET" --target-dir "$W" "$@"
