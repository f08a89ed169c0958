#!/usr/bin/env python3
"""Reads temporal lightmap sets.  pip install numpy OpenEXR

    read_dataset.py yard --hour 12 --out noon.npy                 # a lightmap: height x width x 3, float32
    read_dataset.py yard --hour 12 --layer sun --page 0 --out x.npy

As a module: s = Set('yard'); s.hours; s.light(12); s.layer('sun', 12); s.layer('porch', 21); s.mask()
"""
import argparse, json, pathlib, struct, sys, zlib, numpy as np, OpenEXR

class Set:
    def __init__(self, folder):
        self.root = pathlib.Path(folder)
        layers = self.root / 'layers.json'  # in releases: what config.json says, and the layers
        self.config = json.loads((layers if layers.exists() else self.root / 'config.json').read_text('utf-8'))
        if self.config.get('format') != 'temporal-lightmaps' or self.config['version'] != 1:
            raise ValueError('not a temporal lightmap set of version 1')
        self.hours = [entry['hour'] for entry in self.config['sets']]
    def data(self, file):
        data = (self.root / file['path']).read_bytes()
        if len(data) != file['bytes']:
            raise ValueError(f"{file['path']}: {len(data)} bytes; expected {file['bytes']}")
        return data
    def light(self, hour, page=0): return self.layer('file', hour, page)
    def layer(self, name, hour, page=0):
        """'sun', 'sky', a light group, or 'local', the lamps of imported sets. Black where it does not shine."""
        entry, size = self.config['sets'][self.hours.index(hour)], self.config['pages'][page]
        groups = {g['name']: g['layers'][page:] * on for g, on in zip(self.config['groups'], entry['groups_on'])}
        file = (groups[name] + [None])[0] if name in groups else entry['maps'][page].get(name)
        if file is None:
            return np.zeros((size['height'], size['width'], 3), np.float32)
        self.data(file)
        with OpenEXR.File(str(self.root / file['path'])) as exr:
            return np.asarray(exr.channels()['RGB'].pixels, np.float32)
    def mask(self, page=0):
        """True on surfaces. An 8-bit grey PNG: zipped rows, in front of each the number of its filter."""
        data, at, packed = self.data(self.config['pages'][page]['mask']), 8, b''
        width, height = struct.unpack_from('>2I', data, 16)
        while at < len(data):
            length, kind = struct.unpack_from('>I4s', data, at)
            packed, at = packed + data[at + 8:at + 8 + length] * (kind == b'IDAT'), at + 12 + length
        out = np.zeros((height + 1, width + 1), np.uint8)  # with a black row above, a black column to the left
        for y, row in enumerate(np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, width + 1), 1):
            above = out[y - 1]
            out[y, 1:] = np.cumsum(row[1:], dtype=np.uint8) if row[0] == 1 else row[1:] + above[1:] * (row[0] == 2)
            for x in range(1, width + 1) if row[0] > 2 else []:
                a, b, c = int(out[y, x - 1]), int(above[x]), int(above[x - 1])  # left, above, above left
                near = min((a, b, c), key=lambda value: abs(a + b - c - value)) if row[0] == 4 else (a + b) // 2
                out[y, x] = (int(row[x]) + near) & 255
        return out[1:, 1:] == 255
if __name__ == '__main__':
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, kind in {'folder': {}, '--hour': {'type': float, 'required': True}, '--out': {'required': True},
                       '--page': {'type': int, 'default': 0}, '--layer': {'default': 'file'}}.items():
        args.add_argument(name, **kind)
    args = args.parse_args()
    try:
        np.save(args.out, Set(args.folder).layer(args.layer, args.hour, args.page))
    except (ValueError, OSError, LookupError) as problem:
        sys.exit(f'{args.folder}: {problem}')
