"""How near bundles come to light that they were not made from: that of a converged bake.   pip install numpy OpenEXR blake3

    converged.py REFERENCE DATASET[=BUNDLE] ...        # bundles: DATASET/SCENE.ndgi unless named

The reference is a bake of the same scene, hours and size with another seed and many samples. `compress evaluate` judges every bundle
against its own dataset and against the reference, there over the texels that are valid in all datasets: what only the reference has light on
is gutter to a bundle. `noise` is the mean PSNR that the error of what is judged against gives by itself.
"""
import argparse, json, pathlib, shutil, struct, subprocess, sys, tempfile, zlib
import blake3, numpy as np

root = pathlib.Path(__file__).resolve().parents[3]
sys.path.insert(0, str(root / 'dataset/python'))
from read_dataset import Dataset

def png(mask):
    """An 8-bit grey PNG file."""
    chunk = lambda kind, data: struct.pack('>I', len(data)) + kind + data + struct.pack('>I', zlib.crc32(kind + data))
    rows = b''.join(b'\0' + row.tobytes() for row in np.where(mask, 255, 0).astype(np.uint8))
    head = struct.pack('>2I5B', mask.shape[1], mask.shape[0], 8, 0, 0, 0, 0)
    return b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', head) + chunk(b'IDAT', zlib.compress(rows)) + chunk(b'IEND', b'')

def with_masks(reference, datasets, out):
    """A copy of the reference in which only those texels count that are valid in all datasets."""
    shutil.copytree(reference, out, ignore=shutil.ignore_patterns('.*', '*.ndgi', '*.html'))
    sets = [Dataset(folder) for folder in [reference, *datasets]]
    config = sets[0].config
    for number, page in enumerate(config['pages']):
        masks = [each.mask(number) for each in sets]
        data = png(np.all(masks, axis=0))
        digest = blake3.blake3(data).hexdigest()
        page['mask'] = {'path': f'data/mask-{digest[:12]}.png', 'bytes': len(data), 'blake3': digest}
        (out / page['mask']['path']).write_bytes(data)
    (out / 'config.json').write_text(json.dumps(config))

def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument('reference', type=pathlib.Path)
    args.add_argument('datasets', nargs='+', metavar='DATASET[=BUNDLE]')
    args.add_argument('--compress', type=pathlib.Path, default=root / 'target/release/compress', help='the binary that judges')
    args = args.parse_args()
    pairs = []
    for text in args.datasets:
        folder, _, bundle = text.partition('=')
        pairs.append((pathlib.Path(folder), bundle or pathlib.Path(folder) / f"{Dataset(folder).config['scene']}.ndgi"))
    print('| bundle | judged against | bits a texel and set | all light: mean, pooled, worst 1 % dB | maps alone: mean, pooled dB | noise dB |')
    print('|---|---|---|---|---|---|')
    with tempfile.TemporaryDirectory() as scratch:
        masked = pathlib.Path(scratch) / 'reference'
        with_masks(args.reference, [folder for folder, _ in pairs], masked)
        for folder, bundle in pairs:
            for what, against in ('its dataset', folder), ('the reference', masked):
                command = [args.compress, 'evaluate', against, '--bundle', bundle, '--json', '--quiet']
                told = json.loads(subprocess.run(list(map(str, command)), check=True, stdout=subprocess.PIPE).stdout)
                dbs = lambda *keys: ', '.join(f'{told[key]:.2f}' if told[key] is not None else '-' for key in keys)
                all_light = dbs('psnr_db', 'psnr_pooled_db', 'psnr_worst_percent_db')
                maps = dbs('psnr_without_sun_db', 'psnr_pooled_without_sun_db')
                print(f"| {folder.name} | {what} | {told['bpp']:.3f} | {all_light} | {maps} | {dbs('noise_ceiling_db')} |", flush=True)

main()
