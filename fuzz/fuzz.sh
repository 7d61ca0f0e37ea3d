#!/usr/bin/env bash
# Runs one fuzz target: fuzz.sh TARGET [SECONDS]. Needs build.sh and seeds.py first. Exit 0: nothing found.
set -euo pipefail
cd "$(dirname "$0")"
target=${1:?usage: fuzz.sh archive|bgcode|gcode_line|goo|job|journal|reply|stl|wire [SECONDS]}
seconds=${2:-180}
# Longest input: a few lines, a few layers' beginnings for a job, a small archive or mesh, a few batches of a journal.
case $target in
gcode_line) seeds=gcode_line dict=gcode_line max_len=512 ;;
wire) seeds=gcode_line dict=gcode_line max_len=256 ;;
job) seeds=gcode_line dict=gcode_line max_len=2048 ;;
bgcode) seeds=bgcode dict=bgcode max_len=4096 ;;
journal) seeds=journal dict=journal max_len=2048 ;;
reply) seeds=reply dict=reply max_len=1024 ;;
stl) seeds=stl dict=stl max_len=4096 ;;
archive) seeds=archive dict=archive max_len=4096 ;;
goo) seeds=goo dict=goo max_len=2048 ;;
*) echo "fuzz.sh: no target '$target'" >&2 && exit 2 ;;
esac
triple=$(rustc -vV | sed -n 's/^host: //p')
mkdir -p "target/found/$target"
# 5 s and 512 MB: what a Pi could bear; an input that takes more is a finding.
exec "target/$triple/release/$target" -max_total_time="$seconds" -max_len="$max_len" -timeout=5 -rss_limit_mb=512 \
    -print_final_stats=1 -dict="$dict.dict" -artifact_prefix="target/found/$target-" "target/found/$target" "target/seeds/$seeds"
