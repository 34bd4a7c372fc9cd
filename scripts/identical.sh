#!/usr/bin/env bash
# Checks whether two builds of the command line give identical results. BEFORE and AFTER are two `experiments` programs: `scripts/identical.sh BEFORE
# AFTER`. Compares `metrics.csv` of a small run byte by byte, and a linear picture of every camera of the built-in scene pixel by pixel. To check a
# change that must not affect results, build the commit before the change in a second checkout, and pass both programs.
set -euo pipefail

[ "$#" -eq 2 ] || { echo "usage: scripts/identical.sh BEFORE AFTER (two builds of target/release/experiments)" >&2; exit 2; }
before="$(realpath "$1")"
after="$(realpath "$2")"
root="$(cd "$(dirname "$0")/.." && pwd)"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT

for side in before after; do
    program="${!side}"
    mkdir "$work/$side"
    for camera in cliff ground vista grazing; do
        "$program" render --scene default --camera "$camera" --size 320x180 --out "$work/$side/$camera.exr" >/dev/null 2>&1
    done
    "$program" run "$root/scripts/identical.toml" --out "$work/$side" >/dev/null 2>&1
    mv "$(find "$work/$side" -name metrics.csv)" "$work/$side/metrics.csv"
done

differ=0
say() { echo "$1: $2"; [ "$2" = identical ] || differ=1; }
# Older builds store the tiles of an OpenEXR file in the order in which threads finish them. If the bytes of two files differ, the pixels are
# therefore compared.
for camera in cliff ground vista grazing; do
    before_after=("$work/before/$camera.exr" "$work/after/$camera.exr")
    if cmp -s "${before_after[@]}" || "$after" compare "${before_after[@]}" --metric mse | grep -q 'identical'; then
        say "$camera" identical
    else
        say "$camera" differs
    fi
done
if cmp -s "$work/before/metrics.csv" "$work/after/metrics.csv"; then say metrics.csv identical; else say metrics.csv differs; fi
exit "$differ"
