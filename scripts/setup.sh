#!/usr/bin/env bash
# What a fresh machine needs before `make demo` or `make test`: Rust, and a Vulkan driver.
# Where there is no driver, installs Mesa's software one on Debian and Ubuntu, and says so; elsewhere says what to install.
set -euo pipefail

say() { printf 'setup: %s\n' "$*" >&2; }
fail() { say "$*"; exit 1; }

if ! command -v cargo >/dev/null; then
    if [ -x "${CARGO_HOME:-$HOME/.cargo}/bin/cargo" ]; then
        fail "Rust is installed, but cargo is not on the PATH: run '. \"${CARGO_HOME:-$HOME/.cargo}/env\"' and call make again"
    fi
    fail "cargo was not found: install Rust from https://rustup.rs, open a new shell, and call make again"
fi
if ! command -v cc >/dev/null && ! command -v clang >/dev/null && ! command -v gcc >/dev/null; then
    fail "no C compiler was found, which Rust links with: install one (Debian and Ubuntu: apt-get install build-essential)"
fi
if ! command -v c++ >/dev/null && ! command -v clang++ >/dev/null && ! command -v g++ >/dev/null && [ -z "${CXX:-}" ]; then
    fail "no C++ compiler was found, which FLIP is built with: install one (Debian and Ubuntu: apt-get install g++)"
fi

# Metal and Direct3D 12 belong to the operating system.
[ "$(uname -s)" = Linux ] || exit 0

has_driver() {
    [ -n "${VK_DRIVER_FILES:-}${VK_ICD_FILENAMES:-}" ] && return 0
    compgen -G '/usr/share/vulkan/icd.d/*.json' >/dev/null || compgen -G '/etc/vulkan/icd.d/*.json' >/dev/null
}
# The driver's manifest is of no use without the loader that reads it; a driver that VK_DRIVER_FILES names may bring its own.
has_loader() {
    local ldconfig
    ldconfig="$(command -v ldconfig || echo /sbin/ldconfig)"
    [ -x "$ldconfig" ] || return 0
    # Not `grep -q`: it would stop reading early, and pipefail would call that a failure.
    "$ldconfig" -p | grep 'libvulkan\.so\.1' >/dev/null || [ -n "${LD_LIBRARY_PATH:-}" ]
}

packages=()
has_driver || packages+=(mesa-vulkan-drivers)
has_loader || packages+=(libvulkan1)
[ "${#packages[@]}" -gt 0 ] || exit 0

if ! command -v apt-get >/dev/null; then
    fail "no Vulkan driver (or no Vulkan loader) was found: install your GPU's, or Mesa's software driver" \
        "(Fedora: mesa-vulkan-drivers vulkan-loader; Arch: vulkan-swrast vulkan-icd-loader; Alpine: mesa-vulkan-swrast vulkan-loader)"
fi

as_root=()
if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null ||
        fail "no Vulkan driver (or no Vulkan loader) was found, and there is no sudo to install it with:" \
            "as root, run 'apt-get install ${packages[*]}'"
    as_root=(sudo)
fi

say "no Vulkan driver (or no Vulkan loader) was found; installing Mesa's software Vulkan with apt-get: ${packages[*]}"
install_packages() {
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "${packages[@]}" >&2
}
# The package lists of a fresh image are empty or old: fetch them when the first attempt fails.
install_packages || { "${as_root[@]}" apt-get update >&2 && install_packages; } ||
    fail "apt-get could not install ${packages[*]}: its messages are above; install them by hand and call make again"

has_driver || fail "${packages[*]} installed, yet there is no driver in /usr/share/vulkan/icd.d: install your GPU's Vulkan driver"
say "Vulkan is there now; on a software driver pictures are right, and times are good for ratios only"
