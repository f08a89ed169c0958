"""Error of indirect light as traced, after `bake`'s own filters, and after Open Image Denoise. README.md says what and how."""

import argparse
import json
import pathlib
import struct
import zlib

import numpy
import pyoidn

import renderers
from measure import cpu_seconds, filled

ROOT = renderers.ROOT
# Scene file, hours, and whether a draft is baked.
SCENES = {
    "room": ("scenes/room.toml", "8,11,17,20", True),
    "yard": ("scenes/yard.toml", "8,11,17,20", True),
    "house-in-field": ("tests/fixtures/house-in-field.toml", "9,12,21", False),
}
WAYS = ("traced", "own", "peer", "apart")
# Texels around a chart, where charts are moved apart.
MARGIN = 8


def arguments():
    p = argparse.ArgumentParser(description=__doc__)
    p.add_argument("--scenes", default=",".join(SCENES), help=f"[{','.join(SCENES)}]")
    p.add_argument("--bake", type=pathlib.Path, default=ROOT / "target/release/bake", help="the binary that bakes")
    p.add_argument("--example", type=pathlib.Path, help="the example denoised_error [examples/ beside --bake]")
    p.add_argument("--samples", default="16,64,256", help="of what is denoised [16,64,256]")
    p.add_argument("--ref-samples", type=int, default=512, help="of the reference, which has another seed [512]")
    p.add_argument("--quality", choices=["high", "balanced", "fast"], default="high", help="of Open Image Denoise [high]")
    p.add_argument("--layers", default="sun at 11,sky at 11,lamp", help="layers told one by one: parts of their names")
    p.add_argument("--threads", type=int, default=2, help="of bakes; denoisers are measured on one")
    p.add_argument("--cache", type=pathlib.Path, default=ROOT / "target/peers-cache/denoisers", help="bakes and images")
    p.add_argument("--picture", help="SCENE:SAMPLES:LAYER:FILE.png: a layer, by its number, every way beside the reference")
    a = p.parse_args()
    a.example = a.example or a.bake.parent / "examples/denoised_error"
    return a


def main():
    a = arguments()
    rows = []
    for name in filter(None, a.scenes.split(",")):
        file, hours, is_draft = SCENES[name]
        folder = a.cache / name
        folder.mkdir(parents=True, exist_ok=True)
        test, reference = ROOT / file, seeded(ROOT / file, folder, 77)
        # (`bake` itself knows what it need not trace again.)
        light(a, reference, hours, is_draft, a.ref_samples, folder / "reference")
        for samples in map(int, a.samples.split(",")):
            out = folder / f"{samples}"
            light(a, test, hours, is_draft, samples, out)
            command = [a.example, test, out, reference, folder / "reference", hours, *["--draft"] * is_draft]
            judged, cpu = denoise(a, command, out, folder / f"{samples}-images")
            rows.append((name, samples, judged, cpu))
            print(f"{name} at {samples} samples: done", flush=True)
    if rows:
        show(rows, a.layers.split(","))
    if a.picture:
        picture(a)


def seeded(scene_file, folder, seed):
    """A copy of a scene file with another seed, and with the paths of its files as they are seen from here."""
    lines, is_seeded = [], False
    for line in scene_file.read_text().splitlines():
        key, _, value = line.partition("=")
        if key.strip() == "file":
            line = f'file = "{(scene_file.parent / value.strip().strip(chr(34))).resolve()}"'
        lines.append(line)
        if line.startswith("[bake]"):
            lines.append(f"seed = {seed}")
            is_seeded = True
    if not is_seeded:
        lines += ["", "[bake]", f"seed = {seed}"]
    path = folder / scene_file.name
    path.write_text("\n".join(lines) + "\n")
    return path


def light(a, scene_file, hours, is_draft, samples, out):
    """Bakes as traced, unless that very bake is there."""
    command = [a.bake, scene_file, "--hours", hours, "--extra-times", 0, "--denoise", "off", "--samples", samples]
    renderers.timed([*command, *["--draft"] * is_draft, "--out", out, "--quiet"], a.threads, out.with_suffix(".log"))


def denoise(a, command, dataset, images):
    """Denoises all layers every way; what the example judges, and CPU seconds of each."""
    images.mkdir(exist_ok=True)
    for old in [*(dataset / ".layers").glob("*.filtered"), *images.glob("*.pfm")]:
        old.unlink()
    run = lambda: renderers.timed([*command, "--peer", images], 1, images / "own.log")
    # Once to filter, and once more for what takes no filtering.
    own = run() - run()
    traced = {path: read_pfm(path) for path in sorted(images.glob("*.traced.pfm"))}
    valid = numpy.any([image.max(axis=2) > 0 for image in traced.values()], axis=0)
    charts = read_pfm(images / "charts.pfm")[..., 0].astype(int)
    move = Apart(charts)
    cpu = {"layers": len(traced), "own": own, "peer": 0.0, "apart": 0.0}
    for path, image in traced.items():
        for way in WAYS[2:]:
            # (Only the denoiser's own call is timed.)
            page = filled(image, valid) if way == "peer" else move.there(image)
            before = cpu_seconds()
            page = pyoidn.denoise(page, filter_type="RTLightmap", quality=a.quality)
            cpu[way] += cpu_seconds() - before
            result = page if way == "peer" else move.back(page, result)
            write_pfm(path.with_name(path.name.replace("traced", way)), result)
    run()
    return json.loads((images / "judged.json").read_text()), cpu


class Apart:
    """Charts with more room between them than the page gives them."""

    def __init__(self, charts):
        boxes = []
        for chart in numpy.unique(charts[charts > 0]):
            rows, columns = numpy.nonzero(charts == chart)
            boxes.append((numpy.ptp(rows) + 1, numpy.ptp(columns) + 1, rows, columns))
        boxes.sort(key=lambda box: -box[0])
        # Shelves about as wide as all of it is high.
        area = sum((height + 2 * MARGIN) * (width + 2 * MARGIN) for height, width, _, _ in boxes)
        self.width = max(int(1.1 * area**0.5), max(width for _, width, _, _ in boxes) + 2 * MARGIN)
        x = y = shelf = 0
        here, there = [], []
        for height, width, rows, columns in boxes:
            if x + width + 2 * MARGIN > self.width:
                x, y, shelf = 0, y + shelf, 0
            shelf = max(shelf, height + 2 * MARGIN)
            here.append((rows, columns))
            there.append((rows - rows.min() + y + MARGIN, columns - columns.min() + x + MARGIN))
            x += width + 2 * MARGIN
        self.height = y + shelf
        self.here, self.moved = (tuple(numpy.concatenate(part) for part in zip(*places)) for places in (here, there))

    def there(self, image):
        page, valid = numpy.zeros((self.height, self.width, 3), numpy.float32), numpy.zeros((self.height, self.width), bool)
        page[self.moved], valid[self.moved] = image[self.here], True
        return filled(page, valid)

    def back(self, page, image):
        """What was moved is put back into an image of the page."""
        image = image.copy()
        image[self.here] = page[self.moved]
        return image


def read_pfm(path):
    """A colour PFM file, little-endian; rows from the top."""
    head, size, _, values = path.read_bytes().split(b"\n", 3)
    width, height = map(int, size.split())
    assert head == b"PF"
    return numpy.frombuffer(values, "<f4").reshape(height, width, 3)[::-1]


def write_pfm(path, image):
    path.write_bytes(b"PF\n%d %d\n-1.0\n" % (image.shape[1], image.shape[0]) + image[::-1].astype("<f4").tobytes())


def show(rows, layers):
    print("\nIn this order: as traced, own filters, OIDN on the page, OIDN with charts apart.\n")
    print("| scene | samples | light | median cell, % | 95 % of cells | texels worse by > 5 %, > 50 % | light gained, % | CPU s |")
    print("|---|---|---|---|---|---|---|---|")
    for name, samples, judged, cpu in rows:
        chosen = [layer for layer in judged["layers"] if any(part in layer["name"] for part in layers)]
        for what, ways in [("all sets", judged["sets"]), *((layer["name"], layer["ways"]) for layer in chosen)]:
            if None in ways.values():
                continue
            of = lambda key: ", ".join(f"{100 * ways[way]['local'][key]:.1f}" for way in WAYS)
            worse = ["/".join(f"{100 * share:.1f}" for share in ways[way]["worse"]) for way in WAYS[1:]]
            gained = [f"{100 * ways[way]['gained']:+.2f}" for way in WAYS[1:]]
            seconds = ", ".join(f"{cpu[way]:.1f}" for way in WAYS[1:]) + f" ({cpu['layers']} layers)"
            seconds = seconds if what == "all sets" else ""
            print(f"| {name} | {samples} | {what} | {of('median')} | {of('p95')} | {', '.join(worse)} | {', '.join(gained)} | {seconds} |")


def picture(a):
    """Side by side, 8-bit sRGB; white is the 99th percentile of the reference."""
    scene, samples, layer, file = a.picture.split(":")
    images = a.cache / scene / f"{samples}-images"
    shown = [read_pfm(images / f"{int(layer):02}.{what}.pfm") for what in ("traced", "own", "peer", "apart", "reference")]
    inside = shown[-1].max(axis=2) > 0
    white = numpy.percentile(shown[-1][inside], 99)
    linear = numpy.clip(numpy.concatenate([image * inside[..., None] for image in shown], axis=1) / white, 0, 1)
    codes = numpy.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    codes = numpy.repeat(numpy.repeat((255 * codes + 0.5).astype(numpy.uint8), 2, axis=0), 2, axis=1)
    height, width = codes.shape[:2]
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    raw = b"".join(b"\0" + row.tobytes() for row in codes)
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = [chunk(b"IHDR", head), chunk(b"IDAT", zlib.compress(raw)), chunk(b"IEND", b"")]
    pathlib.Path(file).write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))


main()
