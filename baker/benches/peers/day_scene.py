"""The outdoor day scene of the comparison: a lightmapped ground, and boxes, spheres and trees that shade it.

Everything follows from a fixed seed. The ground has authored lightmap coordinates that fill the page. All surfaces are
two-sided and have one colour each, so that both renderers see plain diffuse reflectors.
"""

import math
import pathlib

import numpy

SIDE = 20.0  # metres; 128 texels are 16 cm each

TOML = """name = "day"
description = "An open ground with boxes, spheres and trees; sun and clear sky"

[place]
latitude = 48.2
longitude = 16.4
utc_offset = 2
date = 2026-10-12

[sun]
disc_angle = 0.533

[sky]
model = "hosek-wilkie"
ground = false

[[object]]
file = "day.obj"
vt = "lightmap"
two_sided = true

[[object.part]]
name = "shade*"
lightmap = false

[lightmap]
size = {size}
padding = 0

[bake]
samples = 64
"""

COLOURS = {
    "ground": (0.30, 0.28, 0.22),
    "plaster": (0.70, 0.68, 0.62),
    "brick": (0.45, 0.22, 0.16),
    "stone": (0.50, 0.50, 0.52),
    "bark": (0.20, 0.14, 0.09),
    "leaf": (0.16, 0.30, 0.08),
}


class Obj:
    """Polygons by object and material, as an OBJ's text."""

    def __init__(self):
        self.lines = ["mtllib day.mtl"]
        self.vertices = 0
        self.triangles = 0

    def part(self, name, material):
        self.lines += [f"o {name}", f"usemtl {material}"]

    def polygons(self, points, faces):
        self.lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in points]
        self.lines += ["f " + " ".join(str(self.vertices + i + 1) for i in face) for face in faces]
        self.vertices += len(points)
        self.triangles += sum(len(face) - 2 for face in faces)

    def box(self, centre, size, turn):
        c, s = math.cos(turn), math.sin(turn)
        points = []
        for y in (-0.05, size[1]):
            for x, z in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                x, z = 0.5 * x * size[0], 0.5 * z * size[2]
                points.append((centre[0] + c * x + s * z, y, centre[1] - s * x + c * z))
        faces = [(0, 1, 2, 3), (7, 6, 5, 4), (1, 0, 4, 5), (2, 1, 5, 6), (3, 2, 6, 7), (0, 3, 7, 4)]
        self.polygons(points, faces)

    def sphere(self, centre, radius, columns=28, rows=16):
        points = [(centre[0], centre[1] + radius, centre[2])]
        for row in range(1, rows):
            theta = math.pi * row / rows
            for column in range(columns):
                phi = 2 * math.pi * column / columns
                points.append(
                    (
                        centre[0] + radius * math.sin(theta) * math.cos(phi),
                        centre[1] + radius * math.cos(theta),
                        centre[2] + radius * math.sin(theta) * math.sin(phi),
                    )
                )
        points.append((centre[0], centre[1] - radius, centre[2]))
        at = lambda row, column: 1 + (row - 1) * columns + column % columns
        faces = []
        for k in range(columns):
            faces.append((0, at(1, k + 1), at(1, k)))
            faces += [(at(r, k), at(r, k + 1), at(r + 1, k + 1), at(r + 1, k)) for r in range(1, rows - 1)]
            faces.append((len(points) - 1, at(rows - 1, k), at(rows - 1, k + 1)))
        self.polygons(points, faces)

    def trunk(self, centre, height, radius, sides=10):
        ring = [2 * math.pi * k / sides for k in range(sides)]
        points = [
            (centre[0] + r * math.cos(a), y, centre[1] + r * math.sin(a))
            for y, r in ((-0.05, radius), (height, 0.6 * radius))
            for a in ring
        ]
        faces = [((k + 1) % sides, k, sides + k, sides + (k + 1) % sides) for k in range(sides)]
        self.polygons(points, faces)

    def leaves(self, centre, radius, count, random):
        for _ in range(count):
            # Uniform in a ball, any orientation.
            direction = random.normal(size=3)
            direction /= numpy.linalg.norm(direction)
            middle = numpy.array(centre) + direction * radius * random.uniform() ** (1 / 3)
            u, v = random.normal(size=3), random.normal(size=3)
            u /= numpy.linalg.norm(u)
            v -= u * (u @ v)
            v /= numpy.linalg.norm(v)
            u, v = u * random.uniform(0.12, 0.24), v * random.uniform(0.12, 0.24)
            self.polygons([middle - u - v, middle + u - v, middle + u + v, middle - u + v], [(0, 1, 2, 3)])


def write(folder: pathlib.Path, size: int) -> pathlib.Path:
    """Writes day.toml, day.obj and day.mtl; returns the scene file."""
    folder.mkdir(parents=True, exist_ok=True)
    random = numpy.random.Generator(numpy.random.PCG64(7))
    obj = Obj()
    h = 0.5 * SIDE
    obj.part("ground", "ground")
    obj.lines += [f"v {x} 0 {z}" for x, z in ((-h, h), (h, h), (h, -h), (-h, -h))]
    obj.lines += [f"vt {u} {v}" for u, v in ((0, 0), (1, 0), (1, 1), (0, 1))]
    obj.lines.append("f 1/1 2/2 3/3 4/4")
    obj.vertices, obj.triangles = 4, 2

    obj.part("shade_house", "plaster")
    obj.box((-5.5, -5.5), (5.0, 3.2, 4.0), 0.3)
    obj.part("shade_walls", "brick")
    obj.box((4.0, -7.0), (7.0, 1.8, 0.3), -0.15)
    obj.box((8.2, 2.0), (0.3, 2.2, 6.0), 0.1)
    obj.part("shade_crates", "stone")
    for _ in range(14):
        x, z = random.uniform(-8.5, 8.5), random.uniform(-3.0, 8.5)
        obj.box((x, z), random.uniform(0.4, 1.1, size=3), random.uniform(0, math.pi))
    obj.part("shade_balls", "plaster")
    for x, z, r in ((-7.0, 3.0, 0.8), (-1.0, 7.5, 0.6), (3.5, 1.0, 1.0), (6.0, 7.0, 0.7)):
        obj.sphere((x, 0.8 * r, z), r)
    for n, (x, z) in enumerate(((-3.0, 2.5), (1.5, -3.5), (6.0, -2.0), (0.5, 4.0), (-8.0, 7.5))):
        obj.part(f"shade_trunk{n}", "bark")
        obj.trunk((x, z), 2.6, 0.16)
        obj.part(f"shade_leaves{n}", "leaf")
        obj.leaves((x, 3.4, z), 1.5, 420, random)

    (folder / "day.obj").write_text("\n".join(obj.lines) + "\n")
    mtl = [f"newmtl {name}\nKd {r} {g} {b}" for name, (r, g, b) in COLOURS.items()]
    (folder / "day.mtl").write_text("\n".join(mtl) + "\n")
    (folder / "day.toml").write_text(TOML.format(size=size))
    print(f"day: {obj.triangles} triangles, {size} x {size} texels")
    return folder / "day.toml"
