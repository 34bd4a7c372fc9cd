#!/usr/bin/env bash
# Makes a Python environment: `scripts/environment.sh NAME FOLDER LIST`. NAME begins each message. The packages of LIST are installed in FOLDER. If
# FOLDER exists and LIST has not changed, they are not installed again.
set -euo pipefail
name="$1" venv="$2" list="$3"

fail() { printf '%s: %s\n' "$name" "$*" >&2; exit 1; }
# A newly installed Debian or Ubuntu may have no Python, or a Python without its venv module.
if ! python3 -c 'import ensurepip, venv' 2>/dev/null && command -v apt-get >/dev/null; then
    as_root=()
    [ "$(id -u)" -eq 0 ] || as_root=(sudo)
    printf '%s: Python with its venv module was not found; installing python3 and python3-venv with apt-get\n' "$name" >&2
    install_python() { "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends python3 python3-venv >&2; }
    install_python || { "${as_root[@]}" apt-get update >&2 && install_python; } || fail "apt-get could not install python3 and python3-venv"
fi
command -v python3 >/dev/null || fail "python3 was not found: install it and its venv module"
if ! cmp -s "$list" "$venv/requirements.txt"; then
    rm -rf "$venv"
    python3 -m venv "$venv" ||
        fail "python3 cannot make a virtual environment: install its venv module (Debian and Ubuntu: apt-get install python3-venv)"
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check -r "$list" ||
        fail "the packages of $list could not be installed (pip's messages are above): check the network connection"
    cp "$list" "$venv/requirements.txt"
fi
