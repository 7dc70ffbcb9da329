#!/bin/sh
# Puts tpmsd and all that belongs to it in place, or takes it away: `make install`, `make uninstall`, `make deb`.
# In: what the Makefile exports: DESTDIR PREFIX BINDIR UNITDIR DOCDIR MANDIR, PIP (a pip 22.3 or newer), EXTRAS (names
# of pyproject.toml with commas between, optional) and PYTHON (optional). Out: files below DESTDIR; those on the root itself are made known to systemd.
#
# The program has a virtual environment of its own in PREFIX, made with the system's Python: one that lives in
# somebody's home would be out of sight of the service. Nothing that is written here names DESTDIR.
set -eu
umask 022

config=/etc/tpmsd
program=$DESTDIR$PREFIX

die() {
    echo "tpmsd: $*" >&2
    exit 1
}

# What may be removed as a whole must be ours.
check_prefix() {
    case $PREFIX in
        */tpmsd*) ;;
        *) die "PREFIX=$PREFIX is a folder of tpmsd's own, so tpmsd must be in its name (such as /opt/tpmsd)" ;;
    esac
}

reload_systemd() {
    [ -z "$DESTDIR" ] || return 0
    [ -d /run/systemd/system ] || return 0
    systemctl daemon-reload || true
    # What runs is started again: its modules were replaced.
    systemctl try-restart tpmsd.service 'tpmsd@*.service' || true
}

find_python() {
    for python in ${PYTHON:-/usr/bin/python3 /usr/bin/python3.1[1-9]}; do
        PYTHON=$python sh tools/find_python.sh 2>/dev/null && return
    done
    sh tools/find_python.sh
}

make_environment() {
    python=$(find_python) || die "no Python to install with"
    case $(readlink -f "$python") in
        /root[/]* | /home/*) echo "tpmsd: $python is below a home: a service with ProtectHome= will not see it" >&2 ;;
    esac
    mkdir -p "$(dirname "$program")"
    "$python" -m venv --clear --without-pip "$program"
    # Modules that a former build left behind would be packed, too.
    rm -rf build/lib build/bdist.*
    $PIP --python "$program/bin/python" install --no-compile --no-warn-script-location ".${EXTRAS:+[$EXTRAS]}" ||
        die "the run-time dependencies could not be installed"
    rm -rf build/lib build/bdist.*
}

# Shebangs and pyvenv.cfg name the folder in which the environment was made.
settle_environment() {
    # It is nobody's environment to work in: what else the modules bring as commands is not installed.
    find "$program/bin" ! -name 'python*' ! -name tpmsd ! -type d -delete
    if [ -n "$DESTDIR" ]; then
        grep -rlIF --exclude-dir=site-packages "$program" "$program" | while read -r file; do
            sed -i "s|$program|$PREFIX|g" "$file"
        done
    fi
    # Where the sources came from is nobody's business later, and would differ between two builds.
    rm -f "$program"/lib/python3*/site-packages/tpmsd-*.dist-info/direct_url.json
    # The lists of installed files have hashes of it and of the commands, which named the folder.
    sed -i -e '/^\.\.\/\.\.\/\.\.\/bin\//d' -e '/\/direct_url\.json,/d' \
        "$program"/lib/python3*/site-packages/*.dist-info/RECORD
    sed -i '/^command = /d' "$program/pyvenv.cfg"
    [ -n "${NO_BYTECODE:-}" ] ||
        "$program/bin/python" -m compileall -q -j 0 ${DESTDIR:+-s "$DESTDIR" -p /} "$program/lib" || true
}

install_unit() {
    mkdir -p "$DESTDIR$UNITDIR"
    sed -e "s|/opt/tpmsd/|$PREFIX/|g" -e "s|/usr/local/share/doc/tpmsd|$DOCDIR|g" "$1" \
        >"$DESTDIR$UNITDIR/$(basename "$1")"
}

# What is made from the parser: manual pages and completions, by the program that was just installed.
install_generated() {
    python="$program/bin/python -B"
    share=$DESTDIR$(dirname "$MANDIR")
    $python tools/make_man.py "$DESTDIR$MANDIR/man1"
    chmod 644 "$DESTDIR$MANDIR"/man1/tpmsd*.1
    for shell in bash:bash-completion/completions/tpmsd zsh:zsh/site-functions/_tpmsd \
        fish:fish/vendor_completions.d/tpmsd.fish; do
        mkdir -p "$share/$(dirname "${shell#*:}")"
        $python -m tpmsd completion "${shell%%:*}" >"$share/${shell#*:}"
        chmod 644 "$share/${shell#*:}"
    done
}

install_all() {
    make_environment
    settle_environment
    mkdir -p "$DESTDIR$BINDIR" "$DESTDIR$config" "$DESTDIR$DOCDIR/examples" "$DESTDIR$MANDIR/man1"
    ln -sfn "$PREFIX/bin/tpmsd" "$DESTDIR$BINDIR/tpmsd"
    install_unit systemd/tpmsd.service
    install_unit systemd/tpmsd@.service
    install_generated
    install -m 644 dbc/tpmsd.dbc LICENSE "$DESTDIR$DOCDIR"
    for kind in tutorial how-to reference explanation; do
        mkdir -p "$DESTDIR$DOCDIR/$kind"
        install -m 644 docs/$kind/*.md "$DESTDIR$DOCDIR/$kind"
    done
    cp -r systemd/examples/. "$DESTDIR$DOCDIR/examples"
    reload_systemd
    [ -n "$DESTDIR" ] || echo "Installed. Next: put $config/tpmsd.toml and its DBC in place, tpmsd check, then" \
        "systemctl enable --now tpmsd ($DOCDIR/how-to/running.md)"
}

uninstall_all() {
    if [ -z "$DESTDIR" ] && [ -d /run/systemd/system ]; then
        systemctl disable --now tpmsd.service 'tpmsd@*.service' 2>/dev/null || true
    fi
    rm -f "$DESTDIR$BINDIR/tpmsd" "$DESTDIR$UNITDIR/tpmsd.service" "$DESTDIR$UNITDIR/tpmsd@.service"
    rm -f "$DESTDIR$MANDIR"/man1/tpmsd.1 "$DESTDIR$MANDIR"/man1/tpmsd-*.1
    share=$DESTDIR$(dirname "$MANDIR")
    rm -f "$share/bash-completion/completions/tpmsd" "$share/zsh/site-functions/_tpmsd" \
        "$share/fish/vendor_completions.d/tpmsd.fish"
    rm -rf "$program" "$DESTDIR$DOCDIR"
    # Configuration and what was learned stay: they are the owner's. An empty folder is nobody's.
    rmdir "$DESTDIR$config" 2>/dev/null || true
    reload_systemd
}

check_prefix
case ${1:-} in
    install) install_all ;;
    uninstall) uninstall_all ;;
    *) die "usage: tools/install.sh install|uninstall" ;;
esac
