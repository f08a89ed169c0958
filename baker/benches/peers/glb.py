"""Reads the scene.glb of a baked dataset into plain arrays (dataset/README.md, "Geometry")."""

import dataclasses
import json
import pathlib
import struct

import numpy

COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}
TYPES = {5123: "<u2", 5125: "<u4", 5126: "<f4"}
GREY = {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1.0]}}  # what the baker gives a primitive without a material


@dataclasses.dataclass
class Mesh:
    """One triangle soup in world space, Y up, with a material per triangle."""

    positions: numpy.ndarray  # [vertex, 3]
    normals: numpy.ndarray  # [vertex, 3]
    uvs: numpy.ndarray  # [vertex, 2], of the textures, v down
    lightmap_uvs: numpy.ndarray  # [vertex, 2], of the page, v down; zero where there is no lightmap
    triangles: numpy.ndarray  # [triangle, 3]
    materials: numpy.ndarray  # [triangle]


@dataclasses.dataclass
class Scene:
    lightmapped: Mesh
    others: Mesh
    materials: list  # of glTF
    images: list  # bytes of PNG per texture
    samplers: list  # of glTF, per texture


def read(path: pathlib.Path) -> Scene:
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    root = json.loads(data[20 : 20 + length])
    binary = data[28 + length :]

    def view(index):
        v = root["bufferViews"][index]
        start = v.get("byteOffset", 0)
        return binary[start : start + v["byteLength"]]

    def accessor(index):
        a = root["accessors"][index]
        width = COMPONENTS[a["type"]]
        values = numpy.frombuffer(view(a["bufferView"]), TYPES[a["componentType"]], a["count"] * width)
        return values.reshape(-1, width).astype(numpy.int64 if a["componentType"] != 5126 else numpy.float64)

    soups = {True: [], False: []}
    materials = root.get("materials", []) + [GREY]
    stack = [(n, numpy.eye(4), False) for n in reversed(root["scenes"][root.get("scene", 0)]["nodes"])]
    while stack:
        index, parent, moves = stack.pop()
        node = root["nodes"][index]
        if node.get("extensions", {}).get("KHR_node_visibility", {}).get("visible") is False:
            continue
        matrix = parent @ local(node)
        extras = node.get("extras", {})
        moves = extras.get("movable", moves)
        stack += [(n, matrix, moves) for n in reversed(node.get("children", []))]
        if "mesh" not in node or moves:  # (What moves is not baked.)
            continue
        flip = numpy.linalg.det(matrix[:3, :3]) < 0
        lit = "lightmapPage" in extras
        for primitive in root["meshes"][node["mesh"]]["primitives"]:
            attributes = primitive["attributes"]
            positions = accessor(attributes["POSITION"]) @ matrix[:3, :3].T + matrix[:3, 3]
            triangles = accessor(primitive["indices"]).reshape(-1, 3)
            triangles = triangles[:, [0, 2, 1]] if flip else triangles
            vertex = lambda name, width: accessor(attributes[name]) if name in attributes else numpy.zeros((len(positions), width))
            page = numpy.zeros((len(positions), 2))
            if lit:
                if extras["lightmapPage"] != 0:
                    raise SystemExit("several pages: not handled")
                page = accessor(attributes["TEXCOORD_1"]) * extras["lightmapScale"] + extras["lightmapOffset"]
            uvs = vertex("TEXCOORD_0", 2)
            if "NORMAL" in attributes:
                normals = accessor(attributes["NORMAL"]) @ numpy.linalg.inv(matrix[:3, :3])
            else:  # flat: every corner is a vertex of its own
                a, b, c = (positions[triangles[:, k]] for k in range(3))
                normals = numpy.repeat(numpy.cross(b - a, c - a), 3, axis=0)
                positions, uvs, page = (v[triangles.flatten()] for v in (positions, uvs, page))
                triangles = numpy.arange(len(positions)).reshape(-1, 3)
            normals /= numpy.maximum(numpy.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
            material = numpy.full(len(triangles), primitive.get("material", len(materials) - 1))
            soups[lit].append(Mesh(positions, normals, uvs, page, triangles, material))
    textures = root.get("textures", [])
    return Scene(
        join(soups[True]),
        join(soups[False]),
        materials,
        [view(root["images"][t["source"]]["bufferView"]) for t in textures],
        [root["samplers"][t["sampler"]] if "sampler" in t else {} for t in textures],
    )


def local(node) -> numpy.ndarray:
    """The matrix of a node."""
    if "matrix" in node:
        return numpy.array(node["matrix"], float).reshape(4, 4).T
    x, y, z, w = node.get("rotation", [0, 0, 0, 1])
    turn = numpy.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = numpy.eye(4)
    matrix[:3, :3] = turn * numpy.array(node.get("scale", [1, 1, 1]), float)
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix


def join(meshes) -> Mesh:
    """All of them as one."""
    if not meshes:
        return Mesh(*(numpy.zeros((0, n)) for n in (3, 3, 2, 2)), numpy.zeros((0, 3), int), numpy.zeros(0, int))
    first = numpy.cumsum([0] + [len(m.positions) for m in meshes])
    pick = lambda name: numpy.concatenate([getattr(m, name) for m in meshes])
    triangles = numpy.concatenate([m.triangles + f for m, f in zip(meshes, first)])
    return Mesh(pick("positions"), pick("normals"), pick("uvs"), pick("lightmap_uvs"), triangles, pick("materials"))
