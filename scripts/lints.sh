#!/usr/bin/env bash
# Runs in place of rustc when cargo compiles this workspace's own crates (RUSTC_WORKSPACE_WRAPPER). Clippy lints the code while it compiles it, and
# rustdoc checks the documentation of libraries. `cargo clippy` and `cargo doc` find the same problems, but they cannot reuse compiled dependencies:
# they check every dependency again first, which takes minutes.
set -euo pipefail

rustc="$1"
shift
clippy-driver "$rustc" "$@" -D warnings

# `told` collects the arguments of a library's compilation that rustdoc also needs.
told=() out="" library=false
arguments=("$@")
for ((i = 0; i < ${#arguments[@]}; i++)); do
    argument="${arguments[i]}"
    case "$argument" in
        --crate-name | --extern | -L | --cfg | --check-cfg) told+=("$argument" "${arguments[++i]}") ;;
        --edition=* | *.rs) told+=("$argument") ;;
        --crate-type) [ "${arguments[++i]}" = lib ] && library=true ;;
        --out-dir) out="${arguments[++i]}" ;;
    esac
done
if $library && [ -n "$out" ]; then
    rustdoc "${told[@]}" --crate-type lib --out-dir "$out/../../doc" -D warnings
fi
