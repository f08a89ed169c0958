#!/usr/bin/env python3
"""Bakes models with a scene file that `bake new` writes, and prints a table of how that went.

    scenes/try-models.py MODEL… > table.md

For every .glb, .gltf or .obj: `bake new`, then `bake --draft --compress` at the defaults of the file, then a preview at 12 h. Everything is
written under --out (models are not touched), which is made anew. Needs `cargo build --release` first; BAKE names another
binary. Ends with 1 if one of them failed.
"""

import argparse
import json
import os
import pathlib
import re
import resource
import subprocess
import sys

BAKE = pathlib.Path(os.environ.get("BAKE", pathlib.Path(__file__).resolve().parent.parent / "target/release/bake"))


def run(arguments, **options):
    """A run of `bake`: exit code, what it printed, CPU seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([BAKE, *arguments], capture_output=True, text=True, **options)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return done, seconds


def row(model, out, hours):
    """The cells of one model, and whether all went well."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", f"{model.parent.name}-{model.stem}").strip("-")
    scene = out / f"{name}.toml"
    new, _ = run(["new", model, "--out", scene, "--force", "--json"])
    if new.returncode != 0:
        return [name, "", "", "", "", "", "", f"`bake new`: {new.stderr.strip().splitlines()[-1]}"], False
    found = json.loads(new.stdout)
    data = out / name
    arguments = [scene, "--hours", hours, "--draft", "--compress", "--out", data, "--json"]
    bake, seconds = run(arguments)
    (out / f"{name}.log").write_text(new.stderr + bake.stderr)
    if bake.returncode != 0:
        last = (bake.stderr.strip().splitlines() or ["killed"])[-1]
        cells = [name, f"{found['triangles']:,}", "", found["unit"], "", f"{seconds:.0f}", "", f"exit {bake.returncode}: {last}"]
        return cells, False
    told = json.loads(bake.stdout)
    facts = " ".join(told["facts"])
    charts = re.search(r"([\d,]+) charts?", facts)
    density = re.search(r"([\d.]+) texels per metre", facts)
    preview, _ = run(["preview", scene, "--dataset", data, "--hour", "12", "--out", out / f"{name}.png", "--size", "640x360"])
    cells = [
        name,
        f"{found['triangles']:,}",
        charts[1] if charts else "?",
        found["unit"],
        density[1] if density else "?",
        f"{seconds:.0f}",
        f"{100 * told['relative_error']:.1f} %",
        str(len(told["warnings"])),
    ]
    drawn = preview.returncode == 0
    if not drawn:
        cells[-1] += f"; preview: {(preview.stderr.strip().splitlines() or ['killed'])[-1]}"
    return cells, drawn


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="+", type=pathlib.Path, metavar="MODEL")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("dataset/tried"), help="folder [default: %(default)s]")
    parser.add_argument("--hours", default="9..18/3", help="hours to bake [default: %(default)s]")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    print("| model | triangles | charts | unit | texels per metre | CPU s | estimated error | warnings |")
    print("|---|---|---|---|---|---|---|---|")
    good = True
    for model in options.models:
        cells, well = row(model, options.out.resolve(), options.hours)
        good &= well
        print("| " + " | ".join(cells) + " |", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
