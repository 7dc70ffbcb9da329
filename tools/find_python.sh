#!/bin/sh
# Prints a Python that can build tpmsd's environment: 3.11 or newer, with venv and ensurepip.
# In: PYTHON (optional), the one to use. Out: its path; or exit 1 and a line that says what to install.
# A name on the PATH proves nothing (version managers leave shims behind), so each candidate is run.
set -u

without_venv=""
for name in ${PYTHON:-python3.11 python3 python3.12 python3.13 python3.14 python}; do
    path=$(command -v "$name" 2>/dev/null) || continue
    "$path" -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1 || continue
    if "$path" -c 'import ensurepip, venv' >/dev/null 2>&1; then
        printf '%s\n' "$path"
        exit 0
    fi
    without_venv="${without_venv:-$path}"
done

if [ -n "$without_venv" ]; then
    echo "$without_venv cannot make virtual environments; on Debian and Ubuntu: sudo apt-get install python3-venv" >&2
else
    echo "no Python 3.11 or newer found (looked for ${PYTHON:-python3.11, python3, python3.12 ...});" \
        "on Debian 12: sudo apt-get install python3 python3-venv; elsewhere: make PYTHON=/path/to/python3" >&2
fi
exit 1
