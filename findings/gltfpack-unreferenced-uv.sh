#!/usr/bin/env bash
# gltfpack 1.3.0 sets lightmap coordinates to zero where no texture of the material refers to any coordinates.
#
# Expected: with -kv ("keep source vertex attributes even if they aren't used"), TEXCOORD_1 comes out as it went in, up to
# rounding to 16 bits. A lightmap is bound by the engine, so no material of the file refers to its coordinates.
# Seen: gltfpack takes the range for quantising from the coordinates that textures refer to. A material without textures
# has none, so its TEXCOORD_0 and TEXCOORD_1 all become 0. The accessors are still there, so programs believe that the
# file has coordinates. gltfpack warns of nothing and exits with 0.
# With -noq the coordinates stay.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
npm install --prefix . --no-audit --no-fund --silent gltfpack@1.3.0
cat >make.py <<'PYTHON'
import json, struct
positions = [0, 0, 0, 1, 0, 0, 1, 0, 1, 0, 0, 1]
page = [0.25, 0.25, 0.5, 0.25, 0.5, 0.5, 0.25, 0.5]
data = struct.pack("<12f", *positions) + struct.pack("<8f", *page) + struct.pack("<6H", 0, 2, 1, 0, 3, 2)
asset = {
    "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"name": "quad", "mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1, "TEXCOORD_1": 1}, "indices": 2}]}],
    "accessors": [
        {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 0, 1]},
        {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
        {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"}],
    "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 32},
                    {"buffer": 0, "byteOffset": 80, "byteLength": 12}],
    "buffers": [{"byteLength": len(data)}]}
text = json.dumps(asset).encode()
text += b" " * (-len(text) % 4)
with open("in.glb", "wb") as out:
    out.write(struct.pack("<III", 0x46546C67, 2, 28 + len(text) + len(data)))
    out.write(struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data)
PYTHON
cat >read.py <<'PYTHON'
import json, struct, sys
data = open(sys.argv[1], "rb").read()
length = struct.unpack_from("<I", data, 12)[0]
asset, body = json.loads(data[20:20 + length]), data[28 + length:]
accessor = asset["accessors"][asset["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"]]
view = asset["bufferViews"][accessor["bufferView"]]
kind = {5126: "f", 5123: "H"}[accessor["componentType"]]
unit = 65535 if accessor.get("normalized") else 1
at = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
step = view.get("byteStride", struct.calcsize("2" + kind))
uvs = sorted(tuple(round(v / unit, 3) for v in struct.unpack_from("<2" + kind, body, at + i * step)) for i in range(accessor["count"]))
print("16 bits" if kind == "H" else "floats", uvs, "texture transform" if "KHR_texture_transform" in asset.get("extensionsUsed", []) else "no texture transform")
PYTHON
python3 make.py
pack() { node_modules/.bin/gltfpack -i in.glb -o out.glb -kn -ke -kv "$@" >log 2>&1 || { cat log; exit 1; }; }
node_modules/.bin/gltfpack -v 2>&1 | head -n 1 || true
echo "in:          $(python3 read.py in.glb)"
pack
packed=$(python3 read.py out.glb)
echo "-kn -ke -kv: $packed"
pack -noq
unquantised=$(python3 read.py out.glb)
echo "… -noq:      $unquantised"
[[ $packed == "16 bits [(0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)] no texture transform" ]]
[[ $unquantised == "floats [(0.25, 0.25), (0.25, 0.5), (0.5, 0.25), (0.5, 0.5)] no texture transform" ]]
echo "as described"
