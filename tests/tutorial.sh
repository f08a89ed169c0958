#!/usr/bin/env bash
# Walks through TUTORIAL.md: runs its commands on a model of the fixtures, opens its page in Chromium, and expects light in the picture.
#   tutorial.sh BIN OUT    BIN: the folder of the binaries; OUT: a new folder
# Needs NDGI_THREE (the folder build of three.js) and NDGI_CHROMIUM for the page, and Python for the server; without them it ends before the page.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
export PATH="$1:$PATH"
mkdir "$2"
cd "$2"
cp "$root/tests/fixtures/house.glb" .
# The block of a language: block FILE LANGUAGE
block() { sed -n "/^\`\`\`$2\$/,/^\`\`\`\$/p" "$root/$1" | sed '/^```/d'; }
while IFS= read -r line; do
    case "$line" in
    "    bake new"*)
        ${line#    }
        block TUTORIAL.md toml >>house.toml
        ;;
    # (Here a draft of the day is enough.)
    "    bake"*0..24*) ${line#    } --draft --quiet ;;
    "    bake"* | "    compress"*) ${line#    } --quiet ;;
    esac
done <"$root/TUTORIAL.md"
ls look/report.html look/preview-*.png day/house.ndgi day/house.view.html day/report.html
if [ -z "${NDGI_THREE:-}" ] || [ -z "${NDGI_CHROMIUM:-}" ]; then
    echo "skipped: the page of the tutorial (NDGI_THREE, NDGI_CHROMIUM)"
    exit
fi
mkdir page
cp day/house.ndgi day/scene.glb "$root"/compressor/view/{bundle,tile,planes,sun}.js "$root/compressor/ndgi/src/sun/words.bin" page
block compressor/INTEGRATION.md js >page/lightmaps.js
# (three.js from this machine, not from the network.)
block TUTORIAL.md html | sed 's#https://unpkg.com/three@[0-9.]*#./three#g' >page/index.html
mkdir page/three && cp -r "$NDGI_THREE" "$NDGI_THREE/../examples" page/three
python3 -u -m http.server --directory page 0 >server.txt 2>&1 &
server=$!
trap 'kill $server' EXIT
until port=$(grep -o 'port [0-9]*' server.txt | cut -d' ' -f2) && [ -n "$port" ]; do sleep 0.1; done
browser() {
    "$NDGI_CHROMIUM" --headless --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --user-data-dir="$PWD/profile" \
        --window-size=980,620 --virtual-time-budget=60000 "$@" "http://127.0.0.1:$port/" 2>>chromium.txt
}
# The page says when it has drawn; a picture of one colour is 4 kB.
browser --dump-dom | grep '<title>lit at 12 h'
browser --screenshot="$PWD/page.png"
[ "$(wc -c <page.png)" -gt 20000 ]
echo "the page of the tutorial: $(wc -c <page.png) bytes of picture"
