#!/usr/bin/env bash
# Compares `bake` with Blender Cycles; arguments go to compare.py (--help lists them). Needs Python 3.11: bpy 5.0 has wheels
# for no other. PEERS_VENV: where the Python packages go [target/peers-venv].
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
root="$(cd "$here/../../.." && pwd)"
venv="${PEERS_VENV:-$root/target/peers-venv}"
if ! cmp -s "$here/requirements.txt" "$venv/installed.txt"; then
    python3.11 -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check -r "$here/requirements.txt"
    cp "$here/requirements.txt" "$venv/installed.txt"
fi
export PYTHONDONTWRITEBYTECODE=1
exec "$venv/bin/python" "$here/compare.py" "$@"
