#!/usr/bin/env bash
# Shows clips to ColorVideoVDP and writes notebooks-data/judges, in a Python environment in .judges: `scripts/judges/judges.sh PROGRAM OUT`. PROGRAM is
# target/release/experiments, OUT a folder for runs. A call that was stopped continues when it is repeated. `scripts/judges/judges.sh --self-test` only
# tests the scripts.
#
# Python's package index has no PyTorch without CUDA for Linux on x86-64, so 3 GB of unused CUDA libraries are installed as well. To avoid them, set
# PIP_EXTRA_INDEX_URL to the folder `cpu` of PyTorch's own index, if the machine can reach it.
set -euo pipefail
root="$(cd "$(dirname "$0")/../.." && pwd)"
here="$root/scripts/judges"
fail() { printf 'judges: %s\n' "$*" >&2; exit 1; }
if [ "$#" -ne 2 ] && [ "$*" != --self-test ]; then fail "usage: scripts/judges/judges.sh PROGRAM OUT, or --self-test"; fi

python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || fail "the packages need python3 3.11 or later"
"$root/scripts/environment.sh" judges "$root/.judges" "$here/requirements.txt"
python=("$root/.judges/bin/python" -B)
"${python[@]}" "$here/judge.py" --self-test
[ "$#" -eq 2 ] || exit 0

program="$(realpath "$1")"
mkdir -p "$2"
out="$(cd "$2" && pwd)"
# The definition of the second run differs from clips.toml in three lines: it has another name and frame rate, and no videos.
sed -e 's/^name = "clips-60"$/name = "clips-30"/' -e 's/frames_per_second = 60/frames_per_second = 30/' -e 's/^video = true$/video = false/' \
    "$here/clips.toml" >"$out/clips-30.toml"
[ "$(diff "$here/clips.toml" "$out/clips-30.toml" | grep -c '^>')" -eq 3 ] || fail "clips.toml no longer has the lines that clips-30 replaces"
"$program" run "$here/clips.toml" "$out/clips-30.toml" --out "$out" --resume
cd "$root"
"${python[@]}" "$here/judge.py" --jobs "$(getconf _NPROCESSORS_ONLN)" --out notebooks-data/judges "$(realpath --relative-to=. "$out/clips-60")" "$(realpath --relative-to=. "$out/clips-30")"
