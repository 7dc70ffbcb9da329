#!/bin/sh
# Builds the Debian package from a copy of the sources, so that nothing is left in them. In: PIP (set by
# `make deb`). Out: build/deb/tpmsd_VERSION_ARCH.deb, and its path on standard output.
set -eu
cd "$(dirname "$0")/.."

for tool in dpkg-buildpackage dh; do
    command -v "$tool" >/dev/null || {
        echo "make deb needs $tool; on Debian: sudo apt-get install debhelper dpkg-dev" >&2
        exit 1
    }
done

version=$(sed -n 's/^__version__ = "\(.*\)"/\1/p' tpmsd/foundation/version.py)
# The package's date is that of its sources, so that the same sources make the same package.
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || date +%s)}
export SOURCE_DATE_EPOCH PIP
# Who builds a package signs for it (the variables are those of devscripts).
maintainer="${DEBFULLNAME:-tpmsd developers} <${DEBEMAIL:-tpmsd@localhost}>"

rm -rf build/deb
source=build/deb/tpmsd-$version
mkdir -p "$source"
cp -r tpmsd dbc docs systemd tools packaging pyproject.toml setup.py README.md LICENSE "$source"
cp -r packaging/debian "$source/debian"
find "$source" -name __pycache__ -type d -prune -exec rm -rf {} +
sed -e '/^@LICENSE@$/{' -e "r LICENSE" -e 'd' -e '}' packaging/debian/copyright |
    awk '/^License: MIT/ { print; licence = 1; next }
         /^Comment:/ { licence = 0 }
         licence { print ($0 == "" ? " ." : " " $0); next }
         { print }' >"$source/debian/copyright"
sed -i "s|@MAINTAINER@|$maintainer|" "$source/debian/control"
cat >"$source/debian/changelog" <<END
tpmsd ($version) unstable; urgency=medium

  * See CHANGELOG.md.

 -- $maintainer  $(LC_ALL=C date -R -u -d "@$SOURCE_DATE_EPOCH")
END
(
    cd "$source"
    # -d: what it takes was looked for above; a compiler is not needed; with one the kernel is compiled.
    dpkg-buildpackage -b -us -uc -d
) >build/deb/build.log 2>&1 || {
    tail -n 20 build/deb/build.log >&2
    echo "the package could not be built (build/deb/build.log)" >&2
    exit 1
}
rm -rf "$source"
ls build/deb/*.deb
