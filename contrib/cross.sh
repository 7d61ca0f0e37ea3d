#!/usr/bin/env bash
# Builds outrigger for a Raspberry Pi (Debian 12 or newer) on an x86-64 machine.
#
#   contrib/cross.sh [--target T]... [--deb] [--test] [CARGO ARGUMENTS]
#
#   contrib/cross.sh                              build --release --bin outrigger, 64 bits
#   contrib/cross.sh --target armv7               the same for 32 bits (Raspberry Pi 2 and newer)
#   contrib/cross.sh --target aarch64 --target armv7 --deb --test
#   contrib/cross.sh run --release -- demo        runs the binary under qemu's user-mode emulation
#
#   --target T   aarch64 (the default) or armv7; may be given twice
#   --deb        makes the .deb besides; needs cargo-deb
#   --test       under qemu: the demo to its end, the parser's tests, the journal's tests
#
# The compiler's standard library comes from rustup where rustup can fetch it. Failing that (or with
# CROSS_FROM=debian), Debian 12's rustc-web and its library are unpacked below target/cross: nothing is
# installed, no foreign architecture is added. CROSS_FROM=rustup forbids that way.
#
# Everything made lies in target/cross and is kept: a second run builds only what changed. The binary is
# target/cross/TRIPLE/release/outrigger, the package target/cross/debian/outrigger_VERSION_ARCH.deb.
set -euo pipefail

FROM=${CROSS_FROM:-auto}
cd "$(dirname "$0")/.."
W=$PWD/target/cross
# The glibc of Debian 12, which the package's `depends` names as well.
GLIBC=2.36

fail() {
    echo "cross.sh: $1" >&2
    exit 1
}

# Sets what is known of a target: TRIPLE (Rust's name), GNU (the compiler's), ARCH (Debian's), QEMU.
know() {
    case $1 in
    aarch64 | arm64 | aarch64-unknown-linux-gnu)
        TRIPLE=aarch64-unknown-linux-gnu GNU=aarch64-linux-gnu ARCH=arm64 QEMU=qemu-aarch64-static
        ;;
    armv7 | armhf | armv7-unknown-linux-gnueabihf)
        TRIPLE=armv7-unknown-linux-gnueabihf GNU=arm-linux-gnueabihf ARCH=armhf QEMU=qemu-arm-static
        ;;
    *) fail "--target is aarch64 or armv7, not '$1'" ;;
    esac
}

# What the host must have: a linker, the C library to link with, and a C++ compiler (for Clipper). Installing is left to the user.
need_tools() {
    local missing=()
    command -v "$GNU-gcc" >/dev/null || missing+=("gcc-$GNU")
    command -v "$GNU-g++" >/dev/null || missing+=("g++-$GNU")
    [ -e "/usr/$GNU/lib/crt1.o" ] || missing+=("libc6-dev-$ARCH-cross")
    if [ "$RUNS" = 1 ]; then
        command -v "$QEMU" >/dev/null || missing+=(qemu-user-static)
    fi
    [ ${#missing[@]} = 0 ] || fail "these packages are missing; as root: apt-get install --no-install-recommends ${missing[*]}"
}

# True when rustup has the target, or can fetch it.
from_rustup() {
    command -v rustup >/dev/null || return 1
    rustup target list --installed 2>/dev/null | grep -qx "$TRIPLE" && return 0
    # A dead link must not hang the build: the library is about 30 MB.
    timeout 300 rustup target add "$TRIPLE"
}

# Unpacks Debian's compiler (amd64) to $W/rw, with an apt of our own that knows both 64-bit architectures; the
# system's is not touched. Sets RUSTC. For 64 bits the standard library comes with it. For 32 bits its source does, and
# cargo builds it: the list of Debian's armhf packages is asked of no mirror, because one that is out of step there would
# stop the 64-bit way too.
from_debian() {
    [ "$(dpkg --print-architecture 2>/dev/null)" = amd64 ] || fail "Debian's compiler needs Debian on x86-64; use rustup instead: rustup target add $TRIPLE"
    export RUSTC=$W/rw/bin/rustc
    if [ "$ARCH" = armhf ]; then
        # -Z is refused by a compiler that calls itself stable, unless it is told that it builds itself.
        export RUSTC_BOOTSTRAP=1
        BUILD_STD=("-Zbuild-std=std,panic_abort,panic_unwind")
    fi
    [ ! -e "$W/rw/complete-$ARCH" ] || return 0
    mkdir -p "$W/apt/state/lists/partial" "$W/apt/cache/archives/partial"
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
        version=$(apt-cache policy rustc-web | sed -n 's/^ *Candidate: //p')
        case $version in
        '' | '(none)') fail "this Debian has no rustc-web: it is in Debian 12 (bookworm) and its security updates" ;;
        esac
        series=$(cut -d. -f1,2 <<<"$version")
        llvm=$(apt-cache show "libstd-rust-web-$series:amd64=$version" | grep -o 'libllvm[0-9]*' | sort -u | tail -1)
        [ -n "$llvm" ] || fail "libstd-rust-web-$series names no libllvm"
        # Compiler and libraries of two versions do not fit together.
        [ "$(cat "$W/rw/version" 2>/dev/null)" = "$version" ] || rm -rf "$W/rw"
        mkdir -p "$W/rw/bin"
        echo "$version" >"$W/rw/version"
        packages=("rustc-web:amd64=$version" "libstd-rust-web-$series:amd64=$version" "libstd-rust-web-dev:amd64=$version" "$llvm:amd64")
        case $ARCH in
        arm64) packages+=("libstd-rust-web-dev:arm64=$version") ;;
        armhf) packages+=("rust-web-src=$version") ;;
        esac
        rm -rf "$W/deb"
        mkdir "$W/deb"
        cd "$W/deb"
        apt-get download "${packages[@]}" || fail "Debian's compiler could not be fetched"
        for deb in *.deb; do dpkg -x "$deb" "$W/rw" || fail "$deb cannot be unpacked"; done
        rm -rf "$W/deb"
        if [ "$ARCH" = armhf ]; then
            # The link that the package has leads to /usr/src; cargo looks for the source behind it.
            source=$(find "$W/rw/usr/src" -maxdepth 1 -name 'rustc-*' -type d | head -1)
            [ -e "$source/library/Cargo.lock" ] || fail "rust-web-src has no library/Cargo.lock"
            mkdir -p "$W/rw/usr/lib/rustlib/src"
            ln -sfn "$source" "$W/rw/usr/lib/rustlib/src/rust"
        fi
    )
    # The compiler finds its own libraries only through the path: it was not installed.
    printf '#!/bin/sh\nLD_LIBRARY_PATH=%q exec %q "$@"\n' "$W/rw/usr/lib/x86_64-linux-gnu" "$W/rw/usr/bin/rustc" >"$RUSTC"
    chmod +x "$RUSTC"
    "$RUSTC" --version || fail "the unpacked compiler does not run"
    touch "$W/rw/complete-$ARCH"
}

# What cargo and the crates' build scripts read: per target, so that build scripts still compile for this machine.
set_tools() {
    local rust=${TRIPLE//-/_}
    local cargo=CARGO_TARGET_${rust^^}
    export "${cargo}_LINKER=$GNU-gcc"
    export "${cargo}_RUNNER=$QEMU -L /usr/$GNU"
    export "CC_$rust=$GNU-gcc" "CXX_$rust=$GNU-g++" "AR_$rust=$GNU-ar"
    # Products and sums are not fused, so that Clipper's offsets have the same bits as on x86-64.
    export "CXXFLAGS_$rust=-ffp-contract=off"
}

# One cargo for the target. nice: a cross build takes tens of minutes of processor time on a small machine.
cargo_for() {
    local verb=$1
    shift
    nice -n 15 cargo "$verb" --locked --target "$TRIPLE" --target-dir "$W" "${BUILD_STD[@]}" "$@"
}

# The package, from the binary that was just built.
make_deb() {
    local bin=$W/$TRIPLE/release/outrigger needs
    needs=$("$GNU-objdump" -T "$bin" | grep -o 'GLIBC_[0-9.]*' | sed 's/GLIBC_//' | sort -Vu | tail -1)
    [ "$(printf '%s\n' "$needs" "$GLIBC" | sort -V | tail -1)" = "$GLIBC" ] ||
        fail "$bin needs glibc $needs and would not start on Debian 12 ($GLIBC): build on Debian 12"
    # The C library's own strip: that of x86-64 does not know the target.
    "$GNU-strip" --strip-unneeded "$bin" -o "$bin.stripped"
    local stage=$W/stage-$ARCH
    rm -rf "$stage"
    mkdir -p "$stage/$TRIPLE/release"
    mv "$bin.stripped" "$stage/$TRIPLE/release/outrigger"
    mkdir -p "$W/debian"
    CARGO_TARGET_DIR=$stage cargo deb --no-build --no-strip --target "$TRIPLE" --output "$W/debian"
    rm -rf "$stage"
}

# What shows that the binary works on the other processor. qemu's emulation of one program does not reach those that it
# starts, as the daemon starts its checks: OUTRIGGER_EXE names them a way.
run_tests() {
    local again=$W/$TRIPLE-outrigger
    printf '#!/bin/sh\nexec %s -L /usr/%s %s "$@"\n' "$QEMU" "$GNU" "$W/$TRIPLE/release/outrigger" >"$again"
    chmod +x "$again"
    OUTRIGGER_EXE=$again cargo_for run --release --bin outrigger -- demo
    # With overflow checks, which tell what 32 bits do not hold.
    cargo_for test -p outrigger-gcode --lib --tests
    cargo_for test -p outrigger --lib -- job::journal
}

TARGETS=() DEB=0 TEST=0
while [ $# -gt 0 ]; do
    case $1 in
    --target)
        [ $# -ge 2 ] || fail "--target wants aarch64 or armv7 behind it"
        TARGETS+=("$2")
        shift 2
        ;;
    --target=*)
        TARGETS+=("${1#--target=}")
        shift
        ;;
    --deb) DEB=1 && shift ;;
    --test) TEST=1 && shift ;;
    -h | --help)
        sed -n '2,/^set /s/^# \{0,1\}//p' "$0"
        exit 0
        ;;
    -*) fail "unknown option $1; see --help" ;;
    *) break ;;
    esac
done
[ ${#TARGETS[@]} -gt 0 ] || TARGETS=(aarch64)
[ $# -gt 0 ] || set -- build --release --bin outrigger
RUNS=$TEST
case $1 in run | test) RUNS=1 ;; esac
command -v cargo >/dev/null || fail "no cargo in the path: install Rust (https://rustup.rs)"
[ "$DEB" = 0 ] || command -v cargo-deb >/dev/null || fail "no cargo-deb in the path: cargo install cargo-deb --locked"

# All that is missing is told before the first of them is built.
for target in "${TARGETS[@]}"; do
    know "$target"
    need_tools
done
for target in "${TARGETS[@]}"; do
    know "$target"
    # A subshell each: what one target sets in the environment makes the other build anew.
    (
        BUILD_STD=()
        case $FROM in
        auto) from_rustup || from_debian ;;
        rustup) from_rustup || fail "rustup has no $TRIPLE and could not fetch it" ;;
        debian) from_debian ;;
        *) fail "CROSS_FROM is auto, rustup or debian, not '$FROM'" ;;
        esac
        set_tools
        cargo_for "$@"
        if [ "$DEB" = 1 ]; then
            make_deb
        fi
        if [ "$TEST" = 1 ]; then
            run_tests
        fi
    )
done
