#!/usr/bin/env bash
# Replaces rustc when cargo compiles the crates of this workspace (RUSTC_WORKSPACE_WRAPPER). Clippy compiles and lints the code at the same time, and
# rustdoc checks the documentation of libraries. `cargo clippy` and `cargo doc` find the same problems, but they cannot reuse compiled dependencies.
# They check every dependency again, which takes minutes.
set -euo pipefail

rustc="$1"
shift
clippy-driver "$rustc" "$@" -D warnings

# When a library is compiled, `told` collects the arguments that rustdoc also needs.
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
