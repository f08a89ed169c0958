"""An NDGI bundle compared with HEVC and AV1 at equal bytes, on the lightmaps of a dataset.   pip install numpy OpenEXR av

    video.py dataset/yard yard.ndgi                                # each atlas page is one video: no tile can be read alone
    video.py dataset/yard yard.ndgi --tiles --json video.json      # each tile of 128 x 128 texels is a video of its own
    video.py dataset/yard yard.ndgi --codec hevc --curves 1 2 log --scales day tile   # other ways from light to samples

Frames are the sets that differ, in the order of hours, with one key frame: no hour can be read alone. Bytes are those of the coded streams
and of the peaks that light is divided by (four each), without containers. Texels that do not count are filled from those around that do. Light is divided by the largest value of the day, of the frame or
of the frame's tile; its root of order `--curves`, or its logarithm, is coded as YCbCr; the defaults gave HEVC pages of the yard the highest
pooled PSNR. Both codecs are tuned for PSNR and use one thread: x265 of 12 bits, 4:4:4; SVT-AV1 of 10 bits and 4:2:0, all that it knows,
where Cb and Cr therefore stand below Y in the luma plane and keep every sample.

PSNR is that of `compress evaluate`: per (tile, set), over valid texels, linear light, peak = the tile's largest valid value. NDGI's row is
measured by the same code on what `compress decode` writes. A codec's row has the finest quantiser whose bytes fit in the bundle's.
"""
import argparse, fractions, itertools, json, math, os, pathlib, subprocess, sys, tempfile, time
os.environ.update(SVT_LOG='1', OMP_NUM_THREADS='1', OPENBLAS_NUM_THREADS='1')  # errors only; one thread
import av, numpy as np, OpenEXR

root = pathlib.Path(__file__).resolve().parents[3]
sys.path.insert(0, str(root / 'dataset/python'))
from read_dataset import Dataset

TILE, WHOLE = 128, np.s_[:, :]
# Rec. 709: RGB to Y, Cb, Cr of full range.
R, G, B, GREY = 0.2126, 0.7152, 0.0722, np.float32([0, 0.5, 0.5])
YCC = np.float32([[R, G, B], np.array([-R, -G, 1 - B]) / (2 - 2 * B), np.array([1 - R, -G, -B]) / (2 - 2 * R)])
# Encoder, decoder, format, largest sample, coarsest quantiser, how many of its steps halve the bytes (about), options.
CODECS = {
    'hevc': ('libx265', 'hevc', 'yuv444p12le', 4095, 51, 6, {'preset': 'slower', 'tune': 'psnr', 'x265-params':
             'log-level=none:info=0:pools=none:frame-threads=1:keyint=-1:scenecut=0:crf='}),
    'av1': ('libsvtav1', 'libdav1d', 'yuv420p10le', 1023, 63, 12, {'preset': '2', 'svtav1-params': 'lp=1:tune=1:keyint=-1:enable-tf=0:crf='})}
# From light to samples and back, both 0 ... 1.
CURVES = {order: (lambda x, n=float(order): x ** (1 / n), lambda y, n=float(order): y ** n) for order in ('1', '1.5', '2', '2.2', '3')}
CURVES['log'] = lambda x: np.log1p(30 * x) / np.log(31), lambda y: np.expm1(y * np.log(31)) / 30
KEYS = ['name', 'quantiser', 'bytes', 'bits_per_valid_texel', 'psnr_db', 'psnr_pooled_db', 'psnr_worst_percent_db', 'psnr_sunny_db',
        'psnr_pooled_sunny_db', 'encode_cpu_seconds', 'decode_cpu_seconds']

def encode(codec, planes, quantiser):
    """Planes, each frames x height x width of 0 ... 1, as packets."""
    name, _, form, top, _, _, options = CODECS[codec]
    context, packets = av.CodecContext.create(name, 'w'), []
    context.height, context.width = planes[0].shape[1:]
    context.pix_fmt, context.options = form, {k: f'{v}{quantiser}' if v.endswith('=') else v for k, v in options.items()}
    context.time_base, context.framerate, context.thread_count = fractions.Fraction(1, 25), fractions.Fraction(25), 1
    for k, samples in enumerate(zip(*planes)):
        frame = av.VideoFrame(context.width, context.height, form)
        frame.pts = k
        for plane, of_plane in zip(frame.planes, samples):
            plane.update(np.pad(np.rint(of_plane.clip(0, 1) * top).astype('<u2'), ((0, 0), (0, plane.line_size // 2 - plane.width))))
        packets += context.encode(frame)
    return packets + context.encode(None)
def decode(codec, packets):
    _, name, _, top, *_ = CODECS[codec]
    context = av.CodecContext.create(name, 'r')
    context.thread_count = 1
    frames = sorted((frame for packet in packets + [None] for frame in context.decode(packet)), key=lambda frame: frame.pts)
    read = lambda plane: np.frombuffer(plane, '<u2').reshape(plane.height, -1)[:, :plane.width]
    return [np.stack(plane) / np.float32(top) for plane in zip(*([read(plane) for plane in frame.planes] for frame in frames))]

def through(codec, samples, quantiser):
    """RGB samples (frames x height x width x 3, 0 ... 1) through a codec: bytes, samples, CPU seconds of coding and of decoding."""
    _, height, width, _ = samples.shape
    more = [(0, max(64, -(-side // 16) * 16) - side) for side in (height, width)]  # encoders refuse less
    planes = list(np.moveaxis(np.pad(samples, [(0, 0), *more, (0, 0)], 'edge') @ YCC.T + GREY, 3, 0))
    if codec == 'av1':
        planes = [np.concatenate(planes, 1)] + 2 * [np.full_like(np.concatenate(planes, 1)[:, ::2, ::2], 0.5)]
    start, packets, middle = time.process_time(), encode(codec, planes, quantiser), time.process_time()
    planes, end = decode(codec, packets), time.process_time()
    planes = np.split(planes[0], 3, 1) if codec == 'av1' else planes
    samples = (np.stack(planes, 3) - GREY) @ np.linalg.inv(YCC).T
    return sum(packet.size for packet in packets), samples[:, :height, :width].clip(0, 1), np.array([middle - start, end - middle])

def fill(samples, mask):
    """Samples whose texels that do not count (mask: height x width) are means of those around that do: averages of 2 x 2 down to one texel,
    and back."""
    samples, weight = samples * mask[..., None], np.float32(mask)[None, ..., None]
    if mask.all() or not mask.any():
        return samples
    even = [(0, 0), (0, mask.shape[0] % 2), (0, mask.shape[1] % 2), (0, 0)]
    halves = lambda x: (lambda x: x.reshape(len(x), x.shape[1] // 2, 2, x.shape[2] // 2, 2, -1).sum((2, 4)))(np.pad(x, even))
    count = halves(weight)
    coarse = fill(halves(samples) / np.maximum(count, 1), count[0, ..., 0] > 0).repeat(2, 1).repeat(2, 2)
    return np.where(weight > 0, samples, coarse[:, :mask.shape[0], :mask.shape[1]])

def tiles(height, width): return [np.s_[y:y + TILE, x:x + TILE] for y in range(0, height, TILE) for x in range(0, width, TILE)]
def coded(pages, masks, codec, by_tiles, curve, scale, quantiser):
    """All pages through a codec: bytes, light, CPU seconds."""
    size, seconds, out, (bend, unbend) = 0, np.zeros(2), [np.empty_like(light) for light in pages], CURVES[curve]
    for light, mask, decoded in zip(pages, masks, out):
        for part in tiles(*light.shape[1:3]) if by_tiles else [WHOLE]:
            here, peak = light[:, *part], np.empty_like(light[:, *part])
            for each in tiles(*here.shape[1:3]) if scale == 'tile' else [WHOLE]:
                counted = here[:, *each] * mask[part][each][..., None]
                largest = counted.max((0, 1, 2, 3) if scale == 'day' else (1, 2, 3), keepdims=True)
                peak[:, *each], size = np.maximum(largest, np.finfo('f4').tiny), size + 4 * largest.size
            of_stream, samples, spent = through(codec, bend(fill(here / peak, mask[part])), quantiser)
            decoded[:, *part], size, seconds = unbend(samples) * peak, size + of_stream, seconds + spent
    return size, out, seconds

def fit(goal, codec, run):
    """The finest quantiser, in eighths, whose bytes fit, and what `run` gives there: bisection, guided by how far the bytes are off."""
    most, halving = CODECS[codec][4:6]
    low, high, at, best = -1, most * 8 + 1, most * 8 // 3, None
    while high - low > 1 and not (best and best[1] > 0.99 * goal):
        size, *rest = run(at / 8)
        low, high, best = (at, high, best) if size > goal else (low, at, (at / 8, size, *rest))
        at = min(max(at + round(8 * halving * math.log2(size / goal)), low + 1), high - 1)
    return best or sys.exit(f'{codec}: no quantiser gets down to {goal} bytes')

def measure(pages, decoded, masks, sets):
    """Mean, pooled and worst 1 % PSNR over (tile, set), as in ../../src/evaluate/quality.rs; None where no pair is judged."""
    psnr, errors, texels = [], 0.0, 0
    for light, back, mask in zip(pages, decoded, masks):
        for k, part in ((k, part) for k in sets for part in tiles(*mask.shape)):
            of = light[k][part][mask[part]].astype(float)
            if len(of) and of.max() > 0 and (of != of[0]).any():  # black and constant ones are judged apart
                error = ((back[k][part][mask[part]] - of) ** 2).mean() / of.max() ** 2
                psnr.append(min(-10 * math.log10(error), 100) if error else 100)
                errors, texels = errors + error * len(of), texels + len(of)
    worst = np.sort(psnr)[:-(-len(psnr) // 100)]
    return [np.mean(psnr), -10 * math.log10(max(errors / texels, 1e-10)), np.mean(worst)] if psnr else 3 * [None]
def decoded_bundle(compress, bundle, hour, page):
    with tempfile.TemporaryDirectory() as folder:
        where = ['--hour', str(hour), '--page', str(page), '--out', f'{folder}/page.exr', '--quiet', '--threads', '1']
        subprocess.run([compress, 'decode', bundle, *where], check=True)
        return np.float32(OpenEXR.File(f'{folder}/page.exr').channels()['RGB'].pixels)

if __name__ == '__main__':
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, kind in {'dataset': {'type': Dataset}, 'bundle': {'type': pathlib.Path},
                       '--codec': {'choices': ['hevc', 'av1', 'hevc,av1'], 'default': 'hevc,av1'},
                       '--tiles': {'action': 'store_true', 'help': 'a video per tile, not per page'},
                       '--curves': {'nargs': '+', 'choices': CURVES, 'default': ['1.5'], 'help': 'roots of light, or log: ln(1 + 30 x)'},
                       '--scales': {'nargs': '+', 'choices': ['day', 'frame', 'tile'], 'default': ['tile'], 'help': 'what has a peak of its own'},
                       '--compress': {'default': root / 'target/release/compress', 'help': 'the binary that decodes the bundle'},
                       '--json': {'type': pathlib.Path, 'help': 'write the rows to this file'}}.items():
        args.add_argument(name, **kind)
    args = args.parse_args()
    dataset, hours, goal = args.dataset, args.dataset.hours, args.bundle.stat().st_size
    sets, numbers, rows = range(len(hours)), range(len(dataset.config['pages'])), []
    pages = [np.stack([dataset.light(hour, page) for hour in hours]) for page in numbers]
    masks = [dataset.mask(page) for page in numbers]
    sunny = [k for k in sets if any(dataset.files('sun', k, page, 'direct') for page in numbers)]
    # Sets that are equal are one frame.
    first = [next(j for j in sets if all(np.array_equal(light[j], light[k]) for light in pages)) for k in sets]
    distinct, valid = sorted(set(first)), sum(int(mask.sum()) for mask in masks)
    def add(name, quantiser, size, decoded, seconds):
        quality = measure(pages, decoded, masks, sets) + measure(pages, decoded, masks, sunny)[:2]
        rows.append(dict(zip(KEYS, [name, quantiser, size, 8 * size / len(sets) / valid, *quality, *seconds])))
        cells = ('–' if v is None else f'{v:{"d" if key == "bytes" else ".3f"}}' for key, v in list(rows[-1].items())[1:])
        print(f'{name:32}' + ''.join(f'{cell:>11}' for cell in cells), flush=True)

    print(f'{len(sets)} sets, {len(distinct)} of them differ; bits per valid texel and set; dB; CPU seconds\n{"":32}' + ''.join(
        f'{title:>11}' for title in ['quantiser', 'bytes', 'bits', 'mean', 'pooled', 'worst 1 %', 'sunny', 's. pooled', 'coding', 'decoding']))
    add('NDGI', None, goal, [[decoded_bundle(args.compress, args.bundle, hour, page) for hour in hours] for page in numbers], (None, None))
    for codec, curve, scale in itertools.product(args.codec.split(','), args.curves, args.scales):
        run = lambda quantiser: coded([light[distinct] for light in pages], masks, codec, args.tiles, curve, scale, quantiser)
        quantiser, size, decoded, seconds = fit(goal, codec, run)
        name = f'{codec}, {"tiles" if args.tiles else "pages"}, {curve}, peak of {scale}'
        add(name, quantiser, size, [light[[distinct.index(k) for k in first]] for light in decoded], seconds)
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1) + '\n')
