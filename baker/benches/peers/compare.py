"""CPU seconds of `bake` and of Blender Cycles to the same error over a day of lightmaps. README.md says what and how."""

import argparse
import json
import os
import pathlib
import platform
import shlex
import time

import day_scene
import measure
import pyoidn
import renderers

ROOT = renderers.ROOT
NOON = 12.0
# The whole day, hour by hour: a range would get extra times at dawn and dusk.
DAY = ",".join(str(hour) for hour in range(24))
# Scene file if it is not made here, the page's side, and the hours that Cycles bakes.
SCENES = {
    "day": (None, 128, "0..24"),
    "yard": ("scenes/yard.toml", 256, "1,8,11,14,17"),
    "house": ("tests/fixtures/house.toml", 128, "1,8,11,14,17"),
}
# Ways to a map, and which one of `bake` each of Cycles' is held against.
FILTERS = {"bake": "off", "bake, denoised": "own"}
PEERS = {"Cycles": "bake", "Cycles, OIDN": "bake, denoised"}
ERRORS = ("rmse", "median", "p95")


def arguments():
    p = argparse.ArgumentParser(description=__doc__)
    p.add_argument("--scene", choices=SCENES, default="day")
    p.add_argument("--size", type=int, help="side of the lightmap [128, yard: 256]")
    p.add_argument("--bake", type=pathlib.Path, default=ROOT / "target/release/bake", help="the binary to measure")
    p.add_argument("--bake-args", default="", metavar="ARGS", help='more arguments of it, as "--backend embree"')
    p.add_argument("--ref-bake", type=pathlib.Path, help="the binary that bakes our reference [--bake]")
    p.add_argument("--ref-args", default="", metavar="ARGS", help='more arguments of it, as "--integrator path"')
    p.add_argument("--sky-image", type=pathlib.Path, help="the example that writes the lights [examples/ beside --bake]")
    p.add_argument("--samples", default="16,64,256", help="of bake [16,64,256]")
    p.add_argument("--cycles-samples", default="16,64", help="of Cycles [16,64]")
    p.add_argument("--ref-samples", type=int, help="of our reference [16 x the most of --samples]")
    p.add_argument("--cycles-ref-samples", type=int, help="of Cycles' reference [16 x the most of --cycles-samples]")
    p.add_argument("--bounces", type=int, help="most reflections [no limit]")
    p.add_argument("--hours", help="hours Cycles bakes [day: 0..24; else 1,8,11,14,17]; the others count as much")
    p.add_argument("--sky-map", default="none", help="Cycles' importance map of the sky: none, auto (its default) or a width")
    p.add_argument("--noon", action="store_true", help="also bake noon alone and compare with the whole day")
    p.add_argument("--no-cycles", action="store_true", help="leave Cycles out")
    p.add_argument("--repeat", type=int, default=1, help="runs of bake, of which the least CPU counts [1]")
    p.add_argument("--threads", type=int, default=2)
    p.add_argument("--cache", type=pathlib.Path, default=ROOT / "target/peers-cache", help="references, Cycles' bakes")
    p.add_argument("--json", type=pathlib.Path, help="also write the result here [CACHE/SCENE-SIZE.json]")
    p.add_argument("--quick", action="store_true", help="a small check of everything, not a measurement")
    a = p.parse_args()
    if a.quick:
        a.size, a.samples, a.cycles_samples, a.hours = a.size or 64, "16,64", "16,64", a.hours or "1,9,12,16"
    _, size, hours = SCENES[a.scene]
    a.size = a.size or size
    a.samples, a.cycles_samples = ([int(s) for s in text.split(",")] for text in (a.samples, a.cycles_samples))
    a.ref_samples = a.ref_samples or 16 * max(a.samples)
    a.cycles_ref_samples = a.cycles_ref_samples or 16 * max(a.cycles_samples)
    every = [float(h) for h in range(24)]
    text = a.hours or hours
    a.hours = every if text == "0..24" else [float(h) for h in text.split(",")]
    a.ref_bake = a.ref_bake or a.bake
    a.sky_image = a.sky_image or a.bake.parent / "examples/sky_image"
    a.bake_args, a.ref_args = shlex.split(a.bake_args), shlex.split(a.ref_args)
    return a


def main():
    a = arguments()
    work = a.cache / f"{a.scene}-{a.size}"
    work.mkdir(parents=True, exist_ok=True)
    file = SCENES[a.scene][0]
    source = ROOT / file if file else day_scene.write(work / "scene", a.size)
    scene = lambda name, bounces, seed: renderers.variant(source, work / "scene", name, a.size, bounces, seed)
    test, reference = scene("test", a.bounces, 1), scene("reference", a.bounces, 2)

    # The light of every hour, and the sun's direct light, which tells where its shadows' edges are.
    every = [float(h) for h in range(24)]
    lights = renderers.write_lights(a.sky_image, test, every, work / "lights", 256)
    sunny = [e["hour"] for e in lights["hours"] if e["sun"]]
    direct = work / "direct"
    renderers.bake(a.bake, scene("direct", 0, 3), DAY, 64, direct, a.threads)
    valid, suns = renderers.read_valid(direct), renderers.read_maps(direct, sunny, "sun")
    masks = {hour: measure.judged(valid, sun) for hour, sun in suns.items()}
    # Hours judged: those that Cycles bakes, with sun, and with a tenth of the texels off the edges.
    day = [h for h in sunny if h in a.hours and masks[h].sum() >= 0.1 * valid.sum()]
    if not day:
        raise SystemExit("none of the hours has sun and a tenth of its texels off the shadows' edges")
    print("judged: " + ", ".join(f"{h:g} h ({masks[h].sum() / valid.sum():.0%})" for h in day) + " of the valid texels")
    cache = a.cache / f"{a.scene}-{a.size}-{renderers.layout_digest(direct / 'scene.glb', lights)}-{a.bounces}"
    cache.mkdir(exist_ok=True)
    result = {
        "scene": a.scene,
        "size": a.size,
        "threads": a.threads,
        "machine": platform.processor() or platform.machine(),
        "load": os.getloadavg()[0],
        "date": time.strftime("%Y-%m-%d"),
        "bake": [str(a.bake), *a.bake_args],
        "hours_judged": day,
    }

    ours = our_reference(a, cache, reference, day)
    job = {"glb": str(direct / "scene.glb"), "lights": str(work / "lights"), "size": [a.size, a.size]}
    job |= {"bounces": a.bounces, "sky_map": a.sky_map}
    if not a.no_cycles:
        theirs = renderers.cycles(
            {**job, "hours": day, "samples": a.cycles_ref_samples, "seed": 2},
            cache / f"cycles-{a.cycles_ref_samples}-{tag(day)}.npz",
            a.threads,
        )
        # Texels inside a solid are black there, and may hold a copy of their neighbours here.
        for h in day:
            lit = (theirs.maps[h].min(axis=2) > 0) & (ours[h].min(axis=2) > 0)
            masks[h] &= measure.judged(valid & lit, suns[h])
    result["judged_fraction"] = {f"{h:g}": masks[h].sum() / valid.sum() for h in day}
    charts = measure.charts(valid)

    def judge(maps, truth, noise):
        """Per hour the errors of `ERRORS`."""
        errors = {}
        for h in day:
            judged = (maps[h], truth[h], masks[h])
            local = measure.local_errors(*judged, charts, noise)
            errors[h] = dict(zip(ERRORS, (measure.relative_rmse(*judged, noise), *local)))
        return errors

    rows = []
    for name, kind in FILTERS.items():
        for samples in a.samples:
            cpu, maps = run_bake(a, test, DAY, samples, work / "test", day, ["--denoise", kind])
            rows.append(row(name, samples, cpu, judge(maps, ours, samples / a.ref_samples)))
    if not a.no_cycles:
        result["references"] = {f"{h:g}": measure.agreement(theirs.maps[h], ours[h], masks[h]) for h in day}
        for samples in a.cycles_samples:
            run = renderers.cycles(
                {**job, "hours": a.hours, "samples": samples, "seed": 1},
                cache / f"cycles-{samples}-{a.sky_map}-{tag(a.hours)}.npz",
                a.threads,
            )
            cpu, noise = whole_day(run, a.hours, sunny), samples / a.cycles_ref_samples
            rows.append(row("Cycles", samples, cpu, judge(run.maps, theirs.maps, noise)))
            seconds, maps = oidn(run.maps, valid & lit, day)
            rows.append(row("Cycles, OIDN", samples, cpu + 24 * seconds, judge(maps, theirs.maps, noise)))
    for r in rows:
        if (ours_name := PEERS.get(r["renderer"])) is None:
            continue
        r["at"] = {}
        for error in ERRORS:
            points = [(other["cpu"], other[error]) for other in rows if other["renderer"] == ours_name]
            seconds, is_between = measure.cpu_at(r[error], points)
            r["at"][error] = {"bake_cpu": seconds, "interpolated": is_between, "ratio": r["cpu"] / seconds}
    result["rows"] = rows
    if a.noon:
        result["noon"] = noon(a, test, ours, masks, rows, work)
    show(result)
    path = a.json or a.cache / f"{a.scene}-{a.size}.json"
    path.write_text(json.dumps(result, indent=1, default=float) + "\n")
    print(f"written: {path}")


def tag(hours):
    return "day" if len(hours) == 24 else "_".join(f"{h:g}" for h in hours)


def row(renderer, samples, cpu, errors):
    means = {name: sum(of[name] for of in errors.values()) / len(errors) for name in ERRORS}
    hours = {f"{h:g}": of for h, of in errors.items()}
    return {"renderer": renderer, "samples": samples, "cpu": cpu, **means, "errors": hours}


def oidn(maps, valid, hours):
    """Denoised as lightmaps are by hand: all light of an hour at once, on the page. CPU seconds an hour, and the maps."""
    before = measure.cpu_seconds()
    call = lambda image: pyoidn.denoise(measure.filled(image, valid), filter_type="RTLightmap", quality="high")
    denoised = {h: call(maps[h]).astype(float) for h in hours}
    return (measure.cpu_seconds() - before) / len(hours), denoised


def our_reference(a, cache, scene_file, day):
    """Bakes it, or takes it from the cache, whichever binary had made it."""
    out = cache / f"bake-{a.ref_samples}"
    done = cache / f"bake-{a.ref_samples}.json"
    if not done.exists():
        cpu = renderers.bake(a.ref_bake, scene_file, DAY, a.ref_samples, out, a.threads, a.ref_args)
        done.write_text(json.dumps({"cpu": cpu, "bake": [str(a.ref_bake), *a.ref_args]}) + "\n")
    return renderers.read_maps(out, day)


def run_bake(a, scene_file, hours, samples, out, day, extra=()):
    extra = [*a.bake_args, *extra]
    cpus = [renderers.bake(a.bake, scene_file, hours, samples, out, a.threads, extra) for _ in range(a.repeat)]
    return min(cpus), renderers.read_maps(out, day)


def whole_day(run, hours, sunny):
    """CPU seconds of 24 bakes: hours that were not baked count as the mean of those that were, with or without sun."""
    if len(hours) == 24:
        return run.cpu
    seconds = dict(zip(hours, json.loads(run.note)))
    total = run.cpu - sum(seconds.values())
    for lit, count in ((True, len(sunny)), (False, 24 - len(sunny))):
        of_kind = [s for h, s in seconds.items() if (h in sunny) == lit]
        total += count * sum(of_kind) / max(len(of_kind), 1)
    return total


def noon(a, scene_file, ours, masks, rows, work):
    """Noon alone against the whole day: CPU seconds at the error that the day's bake has at noon."""
    alone = []
    for samples in a.samples:
        cpu, maps = run_bake(a, scene_file, f"{NOON:g}", samples, work / "noon", [NOON], ["--denoise", "off"])
        error = measure.relative_rmse(maps[NOON], ours[NOON], masks[NOON], samples / a.ref_samples)
        alone.append({"samples": samples, "cpu": cpu, "error": error})
    points = [(r["cpu"], r["error"]) for r in alone]
    for r in (r for r in rows if r["renderer"] == "bake"):
        r["noon_cpu"], r["noon_interpolated"] = measure.cpu_at(r["errors"][f"{NOON:g}"]["rmse"], points)
        r["over_noon"] = r["cpu"] / r["noon_cpu"]
    return alone


def show(result):
    print(f"\n{result['scene']}, {result['size']} x {result['size']} texels, {result['threads']} threads\n")
    print("| renderer | samples | CPU s, 24 hours | relative RMSE | local error: median cell, 95 % | ratios: by RMSE, median, 95 % |")
    print("|---|---|---|---|---|---|")
    for r in result["rows"]:
        line = f"| {r['renderer']} | {r['samples']} | {r['cpu']:.1f} | {r['rmse']:.4f} | {r['median']:.4f}, {r['p95']:.4f} |"
        ratios = [f"{at['ratio']:.1f}" + ("" if at["interpolated"] else "*") for at in r.get("at", {}).values()]
        print(f"{line} {', '.join(ratios)} |")
    print("\n*: `bake` reaches that error outside of what was measured (extrapolated)")
    if "references" in result:
        print("\n| hour | Cycles' reference / ours, mean | RMS difference | median difference |\n|---|---|---|---|")
        for hour, r in result["references"].items():
            print(
                f"| {hour} | {r['mean_ratio']:.4f} | {r['rms_difference']:.4f} | {r['median_difference']:.4f} |"
            )
    if "noon" in result:
        print("\n| noon alone, samples | CPU s | relative RMSE at noon |\n|---|---|---|")
        for r in result["noon"]:
            print(f"| {r['samples']} | {r['cpu']:.2f} | {r['error']:.5f} |")
        print("\n| all hours, samples | CPU s | error at noon | noon alone at that error, CPU s | ratio |\n|---|---|---|---|---|")
        for r in result["rows"]:
            if "over_noon" in r:
                error = r["errors"][f"{NOON:g}"]["rmse"]
                mark = "" if r["noon_interpolated"] else " (extrapolated)"
                print(
                    f"| {r['samples']} | {r['cpu']:.2f} | {error:.5f} | {r['noon_cpu']:.2f}{mark} | {r['over_noon']:.2f} |"
                )
    print()


main()
