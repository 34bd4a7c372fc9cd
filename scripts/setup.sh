#!/usr/bin/env bash
# Checks that a new machine has what `make demo` and `make test` need: Rust, compilers and a Vulkan driver. If there is no driver, this script
# installs Mesa's software driver on Debian and Ubuntu and reports it. On other Linux systems it prints what to install.
#
# Debian 12 has Mesa 22.3.6, which takes minutes to compile a shading pipeline with anisotropic filtering. On Debian 12 the driver is therefore
# installed from bookworm-backports. These variables change this:
#   SCREE_NO_BACKPORTS=1   bookworm-backports is never used
#   SCREE_BACKPORTS=1      an older Mesa that is already installed is replaced
#   CI=true                the same as SCREE_BACKPORTS=1, but only if the machine has no GPU driver
set -euo pipefail

# scripts/test_setup.sh sets SCREE_SETUP_ROOT to a folder that this script then uses as the root of the file system.
root="${SCREE_SETUP_ROOT:-}"
sources="$root/etc/apt/sources.list.d"
own_source="$sources/scree-backports.sources"
# The oldest Mesa that compiles anisotropic shading pipelines in seconds.
good_mesa=23

say() { printf 'setup: %s\n' "$*" >&2; }
fail() { say "$*"; exit 1; }
is_set() { case "${!1:-}" in '' | 0 | false) return 1 ;; esac }

# --- Checks of the machine ---

check_compilers() {
    if ! command -v cargo >/dev/null; then
        if [ -x "${CARGO_HOME:-$HOME/.cargo}/bin/cargo" ]; then
            fail "Rust is installed, but cargo is not on the PATH: run '. \"${CARGO_HOME:-$HOME/.cargo}/env\"' and call make again"
        fi
        fail "cargo was not found: install Rust from https://rustup.rs, open a new shell, and call make again"
    fi
    if ! command -v cc >/dev/null && ! command -v clang >/dev/null && ! command -v gcc >/dev/null; then
        fail "no C compiler was found; Rust needs one to link: install one (Debian and Ubuntu: apt-get install build-essential)"
    fi
    if ! command -v c++ >/dev/null && ! command -v clang++ >/dev/null && ! command -v g++ >/dev/null && [ -z "${CXX:-}" ]; then
        fail "no C++ compiler was found; FLIP needs one: install one (Debian and Ubuntu: apt-get install g++)"
    fi
}

# Prints the paths of the manifests of Vulkan drivers, one per line. If an environment variable names manifests, those of the system are ignored.
driver_manifests() {
    local named="${VK_DRIVER_FILES:-${VK_ICD_FILENAMES:-}}"
    if [ -n "$named" ]; then
        tr ':' '\n' <<<"$named"
    else
        compgen -G "$root/usr/share/vulkan/icd.d/*.json" || true
        compgen -G "$root/etc/vulkan/icd.d/*.json" || true
    fi
}
has_driver() { [ -n "$(driver_manifests)" ]; }

# Returns success if there is a Vulkan loader, which reads the manifests of drivers. A loader is also assumed to exist if ldconfig is missing, or if
# LD_LIBRARY_PATH is set, because the loader may be in one of its folders.
has_loader() {
    local ldconfig
    ldconfig="$(command -v ldconfig || echo /sbin/ldconfig)"
    [ -x "$ldconfig" ] || return 0
    # `grep -q` is not used, because it stops reading at the first match. ldconfig would then fail, and with pipefail the pipeline would also fail.
    "$ldconfig" -p | grep 'libvulkan\.so\.1' >/dev/null || [ -n "${LD_LIBRARY_PATH:-}" ]
}

missing_packages() {
    local names=()
    has_driver || names+=(mesa-vulkan-drivers)
    has_loader || names+=(libvulkan1)
    echo "${names[*]-}"
}

is_debian_12() (
    [ -r "$root/etc/os-release" ] || exit 1
    # shellcheck disable=SC1091
    . "$root/etc/os-release"
    [ "${ID:-}" = debian ] && [ "${VERSION_CODENAME:-}" = bookworm ]
)

# Returns success if a Debian version such as 22.3.6-1+deb12u2 is older than $good_mesa.
is_old() {
    local upstream="${1#*:}"
    [ "${upstream%%.*}" -lt "$good_mesa" ]
}

# Prints the version of the installed package mesa-vulkan-drivers without Debian's revision; prints nothing if the package is not installed.
mesa_version() {
    # shellcheck disable=SC2016 # the fields are dpkg-query's
    dpkg-query -W -f '${db:Status-Status} ${Version}\n' mesa-vulkan-drivers 2>/dev/null | awk '$1 == "installed" { sub(/-[^-]*$/, "", $2); print $2; exit }' || true
}
mesa_is_old() {
    local version
    version="$(mesa_version)"
    [ -n "$version" ] && is_old "$version"
}

# Returns success if a GPU is used. This is the case if there is a driver that is not from Mesa, or a GPU for which an old Mesa has a Vulkan driver.
# Must only be called if Mesa is installed.
has_gpu_driver() {
    grep -sE '^DRIVER=(amdgpu|i915|msm|v3d)' "$root"/sys/class/drm/renderD*/device/uevent >/dev/null && return
    local manifests manifest mesa_files
    manifests="$(driver_manifests)"
    mesa_files="$(dpkg-query -L mesa-vulkan-drivers)"
    while read -r manifest; do
        grep -Fx -e "${manifest#"$root"}" <<<"$mesa_files" >/dev/null || return 0
    done <<<"$manifests"
    return 1
}

# Prints what to do about Mesa on Debian 12: `backports` = install Mesa from the backports, `tell` = print a hint about the backports, `nothing` = do
# nothing.
plan_for_mesa() {
    if ! is_debian_12 || is_set SCREE_NO_BACKPORTS; then
        echo nothing
    elif ! has_driver; then
        echo backports
    elif ! mesa_is_old; then
        echo nothing
    elif is_set SCREE_BACKPORTS; then
        echo backports
    elif has_gpu_driver; then
        echo nothing
    elif is_set CI; then
        echo backports
    else
        echo tell
    fi
}

# --- Installing with apt ---

may_install() { [ "$(id -u)" -eq 0 ] || command -v sudo >/dev/null; }
as_root() { if [ "$(id -u)" -eq 0 ]; then "$@"; else sudo "$@"; fi; }
update_lists() { as_root apt-get update "$@" >&2; }
install_packages() { as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "$@" >&2; }

# Returns success if one of apt's sources of backports offers a sufficiently new Mesa.
newer_mesa_is_offered() {
    local version
    for version in $(apt-cache madison mesa-vulkan-drivers 2>/dev/null | awk -F ' *[|] *' '$3 ~ /-backports\// { print $2 }'); do
        is_old "$version" || return 0
    done
    return 1
}

# Prints the first of apt's source files that contains the backports, if there is one.
backports_source() {
    local files
    files="$(grep -lsE '^[^#]*(bookworm|stable)-backports' "$root/etc/apt/sources.list" "$sources"/*.list "$sources"/*.sources || true)"
    head -n 1 <<<"$files"
}

# Prints the URI of the mirror from which the machine gets Debian 12. A URI that contains a password is not used, because every user could read it in
# the new file.
debian_mirror() {
    # shellcheck disable=SC2016 # the fields are apt's
    apt-get indextargets --format '$(ORIGIN)|$(CODENAME)|$(COMPONENT)|$(REPO_URI)' 'Created-By: Packages' |
        awk -F '|' '$1 == "Debian" && $2 == "bookworm" && $3 == "main" && $4 !~ /^cdrom:|@/ && !found { sub(/\/$/, "", $4); print $4; found = 1 }'
}

# Adds a source file for the backports. It is written under a name that apt ignores and then renamed, so apt never reads an incomplete file.
write_own_source() {
    local text
    text="$(printf '%s\n' "# Added by Scree's scripts/setup.sh for mesa-vulkan-drivers." 'Types: deb' "URIs: $1" 'Suites: bookworm-backports' 'Components: main' \
        'Signed-By: /usr/share/keyrings/debian-archive-keyring.gpg')"
    # shellcheck disable=SC2016 # expanded by the inner shell
    as_root sh -c 'umask 022; new="$1/.scree-backports.new"
        if printf "%s\n" "$3" >"$new" && mv -f "$new" "$2"; then exit 0; fi
        rm -f "$new"; exit 1' sh "$sources" "$own_source" "$text"
}
# Removes the source file if this run added it and could not install Mesa from it. This function is also called when the script ends.
source_added=false
drop_added_source() {
    $source_added || return 0
    source_added=false
    as_root rm -f "$own_source"
    say "removed $own_source again"
}
trap drop_added_source EXIT

# Ensures that apt offers a newer Mesa. Adds a package source if the machine has none that offers it.
offer_newer_mesa() {
    newer_mesa_is_offered && return
    # An error is ignored, because it may be caused by an unrelated source. The next line checks whether the update had an effect.
    update_lists || true
    newer_mesa_is_offered && return

    local present mirror
    present="$(backports_source)"
    if [ -n "$present" ]; then
        say "$present names the backports of Debian 12, but apt offers no newer Mesa from it"
        return 1
    fi
    mirror="$(debian_mirror)" || mirror=""
    if [ -z "$mirror" ]; then
        say "apt's sources name no Debian 12 mirror from which bookworm-backports could be used"
        return 1
    fi

    source_added=true
    write_own_source "$mirror" || return
    say "added the package source bookworm-backports in $own_source; to remove it: delete that file as root and run 'apt-get update'"
    # Only the lists of this source are updated, so an error is not ignored.
    update_lists -o Dir::Etc::sourcelist="$own_source" -o Dir::Etc::sourceparts=/dev/null -o APT::Get::List-Cleanup=0 -o APT::Update::Error-Mode=any &&
        newer_mesa_is_offered
}

# With the option -t, apt also takes the driver's dependencies from the backports. Unrelated packages are not changed, and no package is removed.
install_newer_mesa() {
    local wanted=(--no-remove -t bookworm-backports mesa-vulkan-drivers libvulkan1)
    if offer_newer_mesa && { install_packages "${wanted[@]}" || { update_lists && install_packages "${wanted[@]}"; }; }; then
        source_added=false
        return
    fi
    drop_added_source
    return 1
}

# --- Steps ---

# If the script is interrupted, it ends. The interruption is not reported as a failure of apt.
trap 'exit 130' INT
trap 'exit 143' TERM HUP

check_compilers

# Systems other than Linux need no driver, because Metal and Direct3D 12 are part of the operating system.
[ "$(uname -s)" = Linux ] || exit 0

missing="$(missing_packages)"
plan="$(plan_for_mesa)"
if [ "$plan" = tell ]; then
    say "Mesa $(mesa_version) takes minutes to compile anisotropic shading pipelines, so scenes are drawn with anisotropy 1:" \
        "run 'SCREE_BACKPORTS=1 make setup' for Mesa 25 from bookworm-backports (SCREE_NO_BACKPORTS=1 hides this line)"
fi
if [ -z "$missing" ] && [ "$plan" != backports ]; then
    exit 0
fi

if ! command -v apt-get >/dev/null; then
    fail "no Vulkan driver (or no Vulkan loader) was found: install your GPU's driver, or Mesa's software driver" \
        "(Fedora: mesa-vulkan-drivers vulkan-loader; Arch: vulkan-swrast vulkan-icd-loader; Alpine: mesa-vulkan-swrast vulkan-loader)"
fi
if ! may_install; then
    if [ -n "$missing" ]; then
        fail "no Vulkan driver (or no Vulkan loader) was found, and there is no sudo to install it with:" \
            "as root, run 'apt-get install $missing'$([ "$plan" != backports ] || echo ", best with '-t bookworm-backports'")"
    fi
    say "Mesa $(mesa_version) is kept: the one of bookworm-backports would replace it, but there is no sudo to install it with"
    exit 0
fi

if [ "$plan" = backports ]; then
    if ! has_driver; then
        say "no Vulkan driver was found; installing Mesa's software Vulkan from bookworm-backports with apt-get (SCREE_NO_BACKPORTS=1 declines)"
    else
        say "replacing Mesa $(mesa_version) by the version of bookworm-backports with apt-get (SCREE_NO_BACKPORTS=1 declines)"
    fi
    install_newer_mesa || say "Mesa could not be installed from bookworm-backports (messages above): the driver of Debian 12 is used instead"
    missing="$(missing_packages)"
fi
if [ -n "$missing" ]; then
    say "no Vulkan driver (or no Vulkan loader) was found; installing Mesa's software Vulkan with apt-get: $missing"
    read -ra packages <<<"$missing"
    # In a new container image, the package lists may be missing or old. They are therefore fetched if the first attempt fails.
    install_packages "${packages[@]}" || { update_lists && install_packages "${packages[@]}"; } ||
        fail "apt-get could not install $missing: its messages are above; install the packages by hand and call make again"
fi

has_driver || fail "mesa-vulkan-drivers is installed, but there is no driver in /usr/share/vulkan/icd.d: install your GPU's Vulkan driver"
if is_debian_12 && [ "$plan" != tell ] && mesa_is_old && ! has_gpu_driver; then
    say "Mesa $(mesa_version) takes minutes to compile anisotropic shading pipelines, so scenes are drawn with anisotropy 1"
fi
say "Vulkan is available; with a software driver, pictures are correct, but only ratios of times are meaningful"
