"""Runs `bake` and Cycles as processes of their own and measures their CPU seconds; reads what they wrote."""

import contextlib
import dataclasses
import hashlib
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys

import numpy
import OpenEXR

import glb

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[2]


@dataclasses.dataclass
class Run:
    """The light of some hours and what it took."""

    maps: dict  # hour -> float64 [height, width, 3]
    cpu: float  # user + system seconds of the whole process
    note: str


def timed(command, threads, log: pathlib.Path) -> float:
    """Runs a command on `threads` cores; its user + system seconds."""
    cores = sorted(os.sched_getaffinity(0))[:threads]
    environment = {**os.environ, "RAYON_NUM_THREADS": str(threads), "OMP_NUM_THREADS": str(threads)}
    with log.open("wb") as out:
        process = subprocess.Popen(
            [str(part) for part in command],
            stdout=out,
            stderr=subprocess.STDOUT,
            env=environment,
            preexec_fn=lambda: os.sched_setaffinity(0, cores),
        )
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise SystemExit(f"{command[0]} failed ({process.returncode}):\n{log.read_text(errors='replace')[-4000:]}")
    return usage.ru_utime + usage.ru_stime


# --- bake ---


def variant(scene_file: pathlib.Path, folder: pathlib.Path, name: str, size, bounces, seed, lamps=False) -> pathlib.Path:
    """A copy of a scene file with other settings: no lamps unless asked for, no visibility of the sun, [bake] and
    the page's size as given."""
    sections, current = [], []
    for line in scene_file.read_text().splitlines():
        if line.startswith("["):
            sections.append(current)
            current = []
        current.append(line)
    sections.append(current)
    kept = []
    for section in sections:
        head = section[0] if section else ""
        if head.startswith("[bake]") or (not lamps and re.match(r"\[\[group[.\]]", head)):
            continue
        for line in section:
            file = re.match(r'(\s*file\s*=\s*)"(.*)"', line)
            if file:
                line = f'{file[1]}"{(scene_file.parent / file[2]).resolve()}"'
            if head.startswith("[lightmap]") and re.match(r"\s*size\s*=", line):
                line = f"size = {size}"
            if not (head.startswith("[sun]") and re.match(r"\s*visibility\s*=", line)):
                kept.append(line)
        # (The sun's visibility is a file that no other renderer makes.)
        kept += ['visibility = "off"'] if head.startswith("[sun]") else []
    kept += ["", "[bake]", "samples = 64", f"seed = {seed}", ""] + ([] if bounces is None else [f"bounces = {bounces}"])
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.toml"
    path.write_text("\n".join(kept))
    return path


def bake(binary, scene_file, hours, samples, out: pathlib.Path, threads, extra=()) -> float:
    """Bakes from nothing; CPU seconds."""
    with contextlib.suppress(FileNotFoundError):
        shutil.rmtree(out)
    command = [binary, scene_file, "--hours", hours, "--samples", samples, "--out", out, "--force", *extra]
    return timed(command, threads, out.with_suffix(".log"))


def read_maps(dataset: pathlib.Path, hours, share="file") -> dict:
    """The sets of the given hours: the whole light (`file`) or a share of it (`sun`, `sky`)."""
    config = json.loads((dataset / "config.json").read_text())
    if len(config["pages"]) != 1:
        raise SystemExit(f"{dataset}: {len(config['pages'])} pages, expected one")
    page = config["pages"][0]
    maps = {}
    for index, entry in enumerate(config["frames"]):
        if entry["hour"] not in hours:
            continue
        shares = [layer["files"][index][0] for layer in config["layers"] if layer["light"] == share]
        maps[entry["hour"]] = numpy.zeros((page["height"], page["width"], 3))
        for file in [entry["maps"][0]] if share == "file" else filter(None, shares):
            with OpenEXR.File(str(dataset / file["path"])) as exr:
                maps[entry["hour"]] += exr.channels()["RGB"].pixels
    return maps


def read_valid(dataset: pathlib.Path) -> numpy.ndarray:
    """The validity mask of the page."""
    config = json.loads((dataset / "config.json").read_text())
    return read_grey_png(dataset / config["pages"][0]["mask"]["path"]) > 127


def read_grey_png(path: pathlib.Path) -> numpy.ndarray:
    """An 8-bit grey PNG without interlacing (PNG specification, 9.2: the five filters)."""
    import struct
    import zlib

    data, at, packed = path.read_bytes(), 8, b""
    while at < len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        body = data[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            width, height, depth, colour, _, _, interlace = struct.unpack(">IIBBBBB", body)
            if (depth, colour, interlace) != (8, 0, 0):
                raise SystemExit(f"{path}: expected 8-bit grey")
        elif kind == b"IDAT":
            packed += body
        at += 12 + length
    raw = numpy.frombuffer(zlib.decompress(packed), numpy.uint8).reshape(height, width + 1)
    image = numpy.zeros((height + 1, width), numpy.int64)
    for y in range(height):
        kind, line, up = raw[y, 0], raw[y, 1:].astype(numpy.int64), image[y]
        if kind == 0:
            image[y + 1] = line
        elif kind == 1:
            image[y + 1] = numpy.cumsum(line) & 255
        elif kind == 2:
            image[y + 1] = (line + up) & 255
        else:
            left = corner = 0
            for x in range(width):
                if kind == 3:
                    guess = (left + up[x]) // 2
                else:
                    p = left + up[x] - corner
                    near = [(abs(p - v), i) for i, v in enumerate((left, up[x], corner))]
                    guess = (left, up[x], corner)[min(near)[1]]
                left = (line[x] + guess) & 255
                corner = up[x]
                image[y + 1, x] = left
    return image[1:]


# --- Cycles ---


def write_lights(sky_image, scene_file, hours, folder: pathlib.Path, rows) -> dict:
    """Sun and sky per hour, written by the example `sky_image`; lights.json."""
    command = [sky_image, scene_file, ",".join(f"{h:g}" for h in hours), folder, str(rows)]
    subprocess.run([str(part) for part in command], check=True)
    return json.loads((folder / "lights.json").read_text())


def layout_digest(path: pathlib.Path, lights: dict) -> str:
    """Changes when geometry, lightmap layout, materials or light do."""
    scene, digest = glb.read(path), hashlib.sha256()
    for mesh in (scene.lightmapped, scene.others):
        corners = mesh.triangles.ravel()
        for values in (mesh.positions[corners], mesh.lightmap_uvs[corners]):
            digest.update(numpy.round(values * 1e4).astype("<i8").tobytes())
    digest.update(json.dumps([scene.materials, lights], sort_keys=True).encode())
    return digest.hexdigest()[:12]


def cycles(job: dict, out: pathlib.Path, threads) -> Run:
    """Cycles' bakes of all hours of a job in one process, or what an earlier run of the same job left in the cache."""
    out.parent.mkdir(parents=True, exist_ok=True)
    record = out.with_suffix(".json")
    if not record.exists():
        job = {**job, "threads": threads, "out": str(out)}
        request = out.with_suffix(".job")
        request.write_text(json.dumps(job))
        cpu = timed([sys.executable, HERE / "cycles_bake.py", request], threads, out.with_suffix(".log"))
        record.write_text(json.dumps({"cpu": cpu, "job": job}, indent=1))
    cpu = json.loads(record.read_text())["cpu"]
    stored = numpy.load(out)
    maps = {float(k[5:]): stored[k].astype(numpy.float64) for k in stored.files if k.startswith("hour-")}
    return Run(maps, cpu, json.dumps([round(s, 3) for s in stored["seconds"].tolist()]))
