#!/usr/bin/env bash
# Stands in for rustc where cargo compiles this workspace's own crates (RUSTC_WORKSPACE_WRAPPER): clippy lints while it compiles, and rustdoc reads what
# libraries say of themselves. `cargo clippy` and `cargo doc` find the same, after they have checked every dependency once more without compiling it, which
# takes minutes.
set -euo pipefail

rustc="$1"
shift
clippy-driver "$rustc" "$@" -D warnings

# What rustdoc has to know of a library's compilation.
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
