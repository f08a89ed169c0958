#!/bin/sh
# Puts Embree's shared library, as a wheel of `embreex` on PyPI carries it, where build.rs looks for it: target/embree, or the
# folder given. Needs python3 with pip; x86-64 Linux. Does nothing where it has been done, nor, if no folder is given, where
# the system has Embree 4 (Debian 13: libembree-dev).
set -eu

version=4.4.0.post1
sha256=2cd0f7d5c6342e6247e31f700761689cae7829454d8c6de0c41e62124a023e1f
here=$(cd "$(dirname "$0")" && pwd)
folder=${1:-$here/../../target/embree}
if [ -e "$folder/libembree4.so" ]; then
    exit 0
fi
# A compiler that finds a library names its path; else it repeats the bare name.
if [ $# = 0 ] && [ -e "$(cc -print-file-name=libembree4.so)" ]; then
    exit 0
fi

mkdir -p "$folder"
work=$(mktemp -d "$folder/fetch.XXXXXX")
trap 'rm -rf "$work"' EXIT
# The same wheel whatever Python asks for it; its Python module is not used.
echo "embreex==$version --hash=sha256:$sha256" > "$work/wanted"
if ! python3 -m pip download --quiet --disable-pip-version-check --no-deps --only-binary=:all: --require-hashes \
    --python-version 3.11 --implementation cp --abi cp311 --platform manylinux_2_28_x86_64 \
    --dest "$work" --requirement "$work/wanted" 2> "$work/log"; then
    cat "$work/log" >&2
    echo "fetch-embree.sh: could not download embreex $version from the Python package index" >&2
    exit 1
fi
python3 -m zipfile -e "$work"/embreex-*.whl "$work"
library=$(cd "$work/embreex.libs" && ls libembree4-*.so.4)
mv "$work"/embreex.libs/* "$folder"
# Last, and in one step: its presence means that all is there.
ln -s "$library" "$work/libembree4.so"
mv "$work/libembree4.so" "$folder/libembree4.so"
