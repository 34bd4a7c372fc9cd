#!/usr/bin/env bash
# Tests what scripts/setup.sh does on a machine without Vulkan, on a machine with an old Mesa, and if the backports of Debian 12 are not available.
# Nothing is installed. apt, dpkg and sudo are replaced by stand-ins, which only change a temporary folder. The script can call only these stand-ins
# and the programs below.
set -euo pipefail

if [ "$(uname -s)" != Linux ]; then
    echo "Skipped, because this is not Linux: the test of scripts/setup.sh, which installs nothing here."
    exit 0
fi

scripts="$(cd "$(dirname "$0")" && pwd)"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
bin="$work/bin" root="$work/root" log="$work/log" calls="$work/calls"
old=22.3.6-1+deb12u2 new='25.0.7-2~bpo12+1'
own_source="$root/etc/apt/sources.list.d/scree-backports.sources"
failures=0

stand_in() { cat >"$bin/$1" && chmod +x "$bin/$1"; }

# Programs of the system that the script may call. Its PATH contains only these and the stand-ins.
mkdir "$bin"
for program in awk bash cat dirname env grep head mkdir mv rm sed sh tr uname; do
    ln -s "$(type -P "$program")" "$bin/$program"
done
for program in cargo cc c++; do stand_in "$program" <<<'#!/bin/sh'; done
# shellcheck disable=SC2016 # expanded by the stand-in
stand_in id <<<'#!/bin/sh
echo "$TEST_USER"'
stand_in ldconfig <<<'#!/bin/sh
echo "libvulkan.so.1 => /usr/lib/libvulkan.so.1"'
stand_in dpkg-query <<'END'
#!/bin/sh
[ -e "$TEST_ROOT/installed" ] || exit 1
case "$1" in
    -L) echo /usr/share/vulkan/icd.d/lvp_icd.json ;;
    *) echo "installed $(cat "$TEST_ROOT/installed")" ;;
esac
END
# The stand-ins of apt-cache and apt-get offer a Mesa from the backports if a source names the backports and the lists have been fetched. TEST_BROKEN
# names the step that fails.
stand_in apt-cache <<'END'
#!/bin/sh
[ ! -e "$TEST_ROOT/lists" ] || echo " mesa-vulkan-drivers | $TEST_NEW | http://mirror.test/debian bookworm-backports/main amd64 Packages"
echo " mesa-vulkan-drivers | $TEST_OLD | http://mirror.test/debian bookworm/main amd64 Packages"
END
stand_in apt-get <<'END'
#!/bin/sh
echo "apt-get $*" >>"$TEST_CALLS"
case "$1" in
    indextargets)
        echo 'Other|bookworm|main|http://other.test/debian/'
        echo 'Debian|bookworm-updates|main|http://updates.test/debian/'
        [ "$TEST_BROKEN" = mirror ] || echo 'Debian|bookworm|main|http://mirror.test/debian/' ;;
    update)
        grep -qs '^Suites: bookworm-backports' "$TEST_ROOT"/etc/apt/sources.list.d/* || exit 0
        [ "$TEST_BROKEN" != update ] || exit 100
        : >"$TEST_ROOT/lists" ;;
    install)
        case "$*" in
            *'-t bookworm-backports'*)
                [ -e "$TEST_ROOT/lists" ] && [ "$TEST_BROKEN" != install ] || exit 100
                echo "$TEST_NEW" >"$TEST_ROOT/installed" ;;
            *) [ "$TEST_BROKEN" != everything ] || exit 100
                echo "$TEST_OLD" >"$TEST_ROOT/installed" ;;
        esac
        mkdir -p "$TEST_ROOT/usr/share/vulkan/icd.d"
        : >"$TEST_ROOT/usr/share/vulkan/icd.d/lvp_icd.json" ;;
esac
END
with_sudo() { stand_in sudo <<<'#!/bin/sh
exec "$@"'; }

# machine DISTRIBUTION RELEASE [INSTALLED]: creates a new machine. INSTALLED is the version of the installed Mesa.
machine() {
    rm -rf "$root"
    mkdir -p "$root/etc/apt/sources.list.d" "$root/usr/share/vulkan/icd.d"
    printf 'ID=%s\nVERSION_CODENAME=%s\n' "$1" "$2" >"$root/etc/os-release"
    if [ -n "${3:-}" ]; then
        echo "$3" >"$root/installed"
        : >"$root/usr/share/vulkan/icd.d/lvp_icd.json"
    fi
}
# setup [VARIABLE=VALUE]...: runs the script on the machine, as root unless TEST_USER is the id of a different user.
setup() {
    : >"$calls"
    status=0
    env -i PATH="$bin" HOME="$work" SCREE_SETUP_ROOT="$root" TEST_ROOT="$root" TEST_CALLS="$calls" TEST_OLD="$old" TEST_NEW="$new" TEST_BROKEN= TEST_USER=0 "$@" \
        bash "$scripts/setup.sh" >"$log" 2>&1 || status=$?
}

check() { # check WHAT COMMAND...
    local what="$1"
    shift
    "$@" && return
    failures=$((failures + 1))
    printf 'test_setup: %s: this does not hold: %s\n' "$case_name" "$what" >&2
    sed 's/^/    /' "$log" "$calls" >&2
}
says() { check "says '$1'" grep -F -e "$1" "$log" >/dev/null; }
says_nothing() { check 'says nothing' test ! -s "$log"; }
says_lines() { check "says $1 line(s)" test "$(wc -l <"$log")" -eq "$1"; }
installed() { check "Mesa $1 is installed" test "$(cat "$root/installed" 2>/dev/null)" = "$1"; }
apt_untouched() { check 'does not call apt-get' test ! -s "$calls"; }
ends_with() { check "exit status $1" test "$status" -eq "$1"; }
no_source() { check 'no file in sources.list.d' test -z "$(ls -A "$root/etc/apt/sources.list.d")"; }
anisotropy_1='takes minutes to compile anisotropic shading pipelines, so scenes are drawn with anisotropy 1'

case_name='Debian 12 without a driver'
machine debian bookworm
setup
ends_with 0
installed "$new"
says "$own_source; to remove it: "
check 'the only file in sources.list.d is that of the script' test "$(ls -A "$root/etc/apt/sources.list.d")" = scree-backports.sources
check "the machine's own mirror is named" grep -x 'URIs: http://mirror.test/debian' "$own_source" >/dev/null
check "Debian's key signs it" grep -x 'Signed-By: /usr/share/keyrings/debian-archive-keyring.gpg' "$own_source" >/dev/null
case_name='the same machine again'
setup
ends_with 0
says_nothing
apt_untouched

case_name='Debian 12 without a driver, backports declined'
machine debian bookworm
setup SCREE_NO_BACKPORTS=1 CI=true
ends_with 0
installed "$old"
no_source
says "Mesa 22.3.6 $anisotropy_1"

for step in mirror update install; do
    case_name="Debian 12 without a driver, backports fail at: $step"
    machine debian bookworm
    setup TEST_BROKEN=$step
    ends_with 0
    installed "$old"
    no_source
    says 'the driver of Debian 12 is used instead'
    says "$anisotropy_1"
    [ $step = install ] || check 'does not try to install from there' test -z "$(grep -e '-t bookworm-backports' "$calls")"
done

case_name='Debian 12 without a driver, nothing can be installed'
machine debian bookworm
setup TEST_BROKEN=everything SCREE_NO_BACKPORTS=1
ends_with 1
says 'apt-get could not install mesa-vulkan-drivers'

case_name='Debian 12 with a source of backports already'
machine debian bookworm
printf 'Suites: bookworm-backports\n' >"$root/etc/apt/sources.list.d/mine.sources"
setup
installed "$new"
check 'no second source' test ! -e "$own_source"
case_name='Debian 12 with a source of backports that does not serve'
machine debian bookworm
printf 'Suites: bookworm-backports\n' >"$root/etc/apt/sources.list.d/mine.sources"
setup TEST_BROKEN=update
installed "$old"
says "$root/etc/apt/sources.list.d/mine.sources names the backports"
check 'no second source' test ! -e "$own_source"
check "the user's source is kept" test -e "$root/etc/apt/sources.list.d/mine.sources"

case_name='Debian 12 with its own Mesa'
machine debian bookworm "$old"
setup
ends_with 0
installed "$old"
apt_untouched
says_lines 1
says 'SCREE_BACKPORTS=1 make setup'
setup SCREE_NO_BACKPORTS=1
says_nothing
for asked in CI=true SCREE_BACKPORTS=1; do
    case_name="Debian 12 with its own Mesa, $asked"
    machine debian bookworm "$old"
    setup $asked
    ends_with 0
    installed "$new"
    says "$own_source; to remove it: "
    machine debian bookworm "$old"
    setup $asked TEST_BROKEN=update
    ends_with 0
    installed "$old"
    no_source
done

case_name='Debian 12 with its own Mesa and a GPU'
machine debian bookworm "$old"
: >"$root/usr/share/vulkan/icd.d/nvidia_icd.json"
setup CI=true
says_nothing
apt_untouched
rm "$root/usr/share/vulkan/icd.d/nvidia_icd.json"
mkdir -p "$root/sys/class/drm/renderD128/device"
echo DRIVER=amdgpu >"$root/sys/class/drm/renderD128/device/uevent"
setup CI=true
says_nothing
apt_untouched

case_name='neither root nor sudo'
machine debian bookworm "$old"
setup CI=true TEST_USER=1000
ends_with 0
apt_untouched
says_lines 1
machine debian bookworm
setup TEST_USER=1000
ends_with 1
apt_untouched
says_lines 1
says "as root, run 'apt-get install mesa-vulkan-drivers'"
case_name='sudo'
with_sudo
setup TEST_USER=1000
ends_with 0
installed "$new"

for release in 'debian bullseye' 'debian trixie' 'ubuntu noble'; do
    case_name="$release"
    # shellcheck disable=SC2086 # two words
    machine $release
    setup CI=true
    ends_with 0
    installed "$old"
    no_source
    # shellcheck disable=SC2086
    machine $release "$old"
    setup CI=true
    says_nothing
    apt_untouched
done

case_name='no apt'
rm "$bin/apt-get"
machine fedora ''
setup
ends_with 1
says 'Fedora: mesa-vulkan-drivers vulkan-loader'

[ "$failures" -eq 0 ] || { printf 'test_setup: %d failures\n' "$failures" >&2; exit 1; }
