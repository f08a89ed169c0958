"""Runs our bench and the PyTorch trainer in turn and prints the least milliseconds per step of each; see README.md."""
import json, pathlib, subprocess, sys

here = pathlib.Path(__file__).parent
# Multiply-adds of a sample that no implementation can leave out (README.md).
FLOOR = 1488 + 64 + 32 * 6


def output(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def ours():
    # The row of 1000 steps: "iterations  s/tile (float, all)  ms/iteration  ...".
    line = output('cargo', 'bench', '--quiet', '-p', 'compressor', '--bench', 'train', '--', '1000').splitlines()[-1]
    return float(line.split()[3])


def torch(*options):
    lines = output(sys.executable, str(here / 'trainer.py'), '--steps', '150', *options).splitlines()
    return {row['way']: row['ms'] for row in map(json.loads, lines)}


least, peak = {}, 0.0
for _ in range(int(sys.argv[1])):
    for name, ms in {'ours': ours(), **torch(), **torch('--ways', 'index', '--compile')}.items():
        least[name] = min(ms, least.get(name, ms))
    peak = max(peak, float(output(str(pathlib.Path(sys.prefix) / 'peak'))))
    print(' '.join(f'{name} {ms:.3f}' for name, ms in least.items()), flush=True)
for name, ms in least.items():
    print(f'{name:16} {ms:7.3f} ms/step {4.096 / ms:6.2f} Msamples/s {ms / least["ours"]:6.1f} x ours')
rate = 4.096e-3 / least['ours'] * FLOOR
print(f'ours: {FLOOR} multiply-adds a sample at least, {rate:.1f} of {peak:.1f} G/s: {100 * rate / peak:.0f} % of the core\'s peak')
