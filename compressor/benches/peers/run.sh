#!/usr/bin/env bash
# Times a training step of `compress` and of the same recipe in PyTorch, one thread each, in turn. `run.sh [ROUNDS]`, default 5;
# the least of all rounds counts. PEERS_VENV: where the Python packages go [target/peers-torch].
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
root="$(cd "$here/../../.." && pwd)"
venv="${PEERS_VENV:-$root/target/peers-torch}"
if ! cmp -s "$here/requirements.txt" "$venv/installed.txt"; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check -r "$here/requirements.txt"
    cp "$here/requirements.txt" "$venv/installed.txt"
fi
cd "$root"
cargo build --quiet --release -p compressor --benches
cc -O3 -funroll-loops "$here/peak.c" -o "$venv/peak"
export PYTHONDONTWRITEBYTECODE=1
exec "$venv/bin/python" "$here/compare.py" "${1:-5}"
