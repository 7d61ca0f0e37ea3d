#!/usr/bin/env bash
# Builds the fuzz targets with the stable compiler, without cargo-fuzz: the flags are those that cargo-fuzz
# would give, and libFuzzer itself comes with libfuzzer-sys. The programs are in target/TRIPLE/release/.
set -euo pipefail
cd "$(dirname "$0")"
triple=$(rustc -vV | sed -n 's/^host: //p')
# --target keeps the flags away from build scripts.
RUSTFLAGS="--cfg fuzzing -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table -Cllvm-args=-sanitizer-coverage-trace-compares -Ccodegen-units=1" \
    cargo build --release --target "$triple" "$@"
echo "built: fuzz/target/$triple/release/"
