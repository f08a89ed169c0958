#!/usr/bin/env bash
# Compares `bake`'s filters with Open Image Denoise; arguments go to denoisers.py (--help lists them). PEERS_VENV: where the
# Python packages go [target/denoisers-venv].
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
root="$(cd "$here/../../.." && pwd)"
venv="${PEERS_VENV:-$root/target/denoisers-venv}"
if ! cmp -s "$here/denoisers.txt" "$venv/installed.txt"; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check -r "$here/denoisers.txt"
    cp "$here/denoisers.txt" "$venv/installed.txt"
fi
export PYTHONDONTWRITEBYTECODE=1
exec "$venv/bin/python" "$here/denoisers.py" "$@"
