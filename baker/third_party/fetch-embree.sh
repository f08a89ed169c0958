#!/bin/sh
# Puts Embree's shared library, as the PyPI wheel `embreex` carries it, where build.rs looks for it: target/embree, or the
# folder given. Needs python3 with pip; x86-64 Linux. Does nothing where it has been done. Not needed on Debian 13 and newer,
# which have libembree-dev.
set -eu

version=4.4.0.post1
here=$(cd "$(dirname "$0")" && pwd)
folder=${1:-$here/../../target/embree}
if [ -e "$folder/libembree4.so" ]; then
    exit 0
fi

mkdir -p "$folder"
work=$(mktemp -d "$folder/fetch.XXXXXX")
trap 'rm -rf "$work"' EXIT
if ! python3 -m pip download --quiet --disable-pip-version-check --no-deps --only-binary=:all: \
    --dest "$work" "embreex==$version" 2> "$work/log"; then
    cat "$work/log" >&2
    echo "fetch-embree.sh: could not download embreex $version from the Python package index" >&2
    exit 1
fi
python3 -m zipfile -e "$work"/embreex-*.whl "$work"
mv "$work"/embreex.libs/* "$folder"
library=$(cd "$folder" && ls libembree4-*.so.4)
# Last, and in one step: its presence means that all is there.
ln -s "$library" "$work/libembree4.so"
mv "$work/libembree4.so" "$folder/libembree4.so"
