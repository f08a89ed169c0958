"""Reads the scene.glb of a baked dataset into plain arrays (dataset/README.md, "Geometry")."""

import dataclasses
import json
import pathlib
import struct

import numpy

COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}
TYPES = {5123: "<u2", 5125: "<u4", 5126: "<f4"}


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
    parent = root["nodes"][root["scenes"][0]["nodes"][0]]
    shift = numpy.array(parent.get("translation", [0, 0, 0]), float)
    for child in parent["children"]:
        node = root["nodes"][child]
        matrix = numpy.array(node.get("matrix", numpy.eye(4).flatten()), float).reshape(4, 4).T
        flip = numpy.linalg.det(matrix[:3, :3]) < 0
        extras = node.get("extras")
        for primitive in root["meshes"][node["mesh"]]["primitives"]:
            attributes = primitive["attributes"]
            positions = accessor(attributes["POSITION"]) @ matrix[:3, :3].T + matrix[:3, 3] + shift
            normals = accessor(attributes["NORMAL"]) @ numpy.linalg.inv(matrix[:3, :3])
            normals /= numpy.maximum(numpy.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
            triangles = accessor(primitive["indices"]).reshape(-1, 3)
            page = numpy.zeros((len(positions), 2))
            if extras:
                if extras["lightmapPage"] != 0:
                    raise SystemExit("several pages: not handled")
                page = accessor(attributes["TEXCOORD_1"]) * extras["lightmapScale"] + extras["lightmapOffset"]
            soups[extras is not None].append(
                Mesh(
                    positions,
                    normals,
                    accessor(attributes["TEXCOORD_0"]),
                    page,
                    triangles[:, [0, 2, 1]] if flip else triangles,
                    numpy.full(len(triangles), primitive["material"]),
                )
            )
    textures = root.get("textures", [])
    return Scene(
        join(soups[True]),
        join(soups[False]),
        root["materials"],
        [view(root["images"][t["source"]]["bufferView"]) for t in textures],
        [root["samplers"][t["sampler"]] for t in textures],
    )


def join(meshes) -> Mesh:
    """All of them as one."""
    if not meshes:
        return Mesh(*(numpy.zeros((0, n)) for n in (3, 3, 2, 2)), numpy.zeros((0, 3), int), numpy.zeros(0, int))
    first = numpy.cumsum([0] + [len(m.positions) for m in meshes])
    pick = lambda name: numpy.concatenate([getattr(m, name) for m in meshes])
    triangles = numpy.concatenate([m.triangles + f for m, f in zip(meshes, first)])
    return Mesh(pick("positions"), pick("normals"), pick("uvs"), pick("lightmap_uvs"), triangles, pick("materials"))
