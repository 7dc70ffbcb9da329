#!/bin/sh
# Builds all that is published, checks it and prints the hashes: `make release`. In: PY (a Python with the extras dev, docs and release), the sources as
# committed. Out: build/release: wheels, sdist, Debian package, SBOM and SHA256SUMS. The same sources make the same bytes: time stamps
# are those of the last commit (SOURCE_DATE_EPOCH).
set -eu
unset PYTHONPATH
cd "$(dirname "$0")/.."
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct)}
export SOURCE_DATE_EPOCH
out=$PWD/build/release
version=$(sed -n 's/^__version__ = "\(.*\)"/\1/p' tpmsd/foundation/version.py)

die() {
    echo "release: $*" >&2
    exit 1
}

tag=$(git describe --exact-match --tags --match 'v*' 2>/dev/null || true)
[ -z "$tag" ] || [ "$tag" = "v$version" ] || die "the tag is $tag, the version $version"
[ -n "${RELEASE_DIRTY:-}" ] || [ -z "$(git status --porcelain --untracked-files=no)" ] || die "commit first: what is built is what is tagged"

# A copy of what is committed, so that nothing else of the working tree comes in; file times are those of the commit.
rm -rf "$out" build/release-src
mkdir -p "$out" build/release-src
git archive HEAD | tar -x -C build/release-src
find build/release-src -exec touch -h -d "@$SOURCE_DATE_EPOCH" {} +
(cd build/release-src && "$PY" -m build --no-isolation --sdist --outdir "$out" .) >build/release.log 2>&1 || die "see build/release.log"
# Compiled wheels for x86_64 and aarch64, and one without kernels that fits every machine.
"$PY" tools/make_wheels.py build/release-src "$out" || die "the wheels"
"$PY" tools/repack_sdist.py "$out"/*.tar.gz
"$PY" -m twine check --strict "$out"/*.whl "$out"/*.tar.gz >>build/release.log 2>&1 || die "twine: see build/release.log"

if command -v dpkg-buildpackage >/dev/null && [ -z "${RELEASE_NO_DEB:-}" ]; then
    PIP="$PY -m pip --disable-pip-version-check -q" sh tools/make_deb.sh >/dev/null
    cp build/deb/*.deb "$out"
    own_address=""
    if [ -z "${DEBEMAIL:-}" ]; then
        echo "release: without DEBFULLNAME and DEBEMAIL the Debian package names tpmsd@localhost as its maintainer" >&2
        own_address="--suppress-tags bogus-mail-host,bogus-mail-host-in-debian-changelog"
    fi
    # shellcheck disable=SC2086 # an option, or none
    ! command -v lintian >/dev/null || lintian --fail-on error,warning $own_address "$out"/*.deb || die "lintian"
fi

# The wheels as built, each in an environment of its own: the compiled one says so, and both find the same radii and alarms.
for kind in compiled numpy; do
    case $kind in
    compiled) wheel=$(ls "$out"/*-manylinux_*_"$(uname -m)".whl) ;;
    numpy) wheel=$(ls "$out"/*-py3-none-any.whl) ;;
    esac
    env=build/release-env-$kind
    "$PY" -m venv --clear "$env"
    # From an index of its own, as users have it: a folder with the wheel and what it needs.
    index=build/release-index-$kind
    rm -rf "$index"
    "$env"/bin/python -m pip download -q --disable-pip-version-check --dest "$index" "$wheel"
    "$env"/bin/python -m pip install -q --disable-pip-version-check --no-index --find-links "$index" "tpmsd==$version"
    (cd "$env" && bin/tpmsd --version | grep -q "(kernel: $kind)") || die "the wheel for $kind is not $kind"
    (cd "$env" && bin/tpmsd simulate drive --force --duration 120 --puncture rl --at 60 --seed 1 >/dev/null 2>&1 && bin/tpmsd check drive >/dev/null &&
        bin/tpmsd replay drive --json replay.json >/dev/null 2>&1) || die "the wheel for $kind does not work in a clean environment"
done
"$PY" tools/compare_replays.py build/release-env-compiled/replay.json build/release-env-numpy/replay.json || die "the kernels differ"
# Speed as in a clone: the wheel is as fast as the sources beside it, within 5 % of the CPU time.
build/release-env-compiled/bin/tpmsd simulate build/release-env-compiled/long --force --duration 300 --seed 1 >/dev/null 2>&1
"$PY" tools/compare_speed.py build/release-env-compiled/bin/python "$PY" build/release-env-compiled/long || die "the wheel is slower than the clone"
"$PY" tools/make_sbom.py build/release-env-compiled/bin/python >"$out/tpmsd-$version.sbom.json"

(cd "$out" && sha256sum ./* >SHA256SUMS && cat SHA256SUMS)
