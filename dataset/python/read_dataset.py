#!/usr/bin/env python3
"""Reads temporal lightmap datasets, versions 1 and 2 of the format.  pip install numpy OpenEXR

    read_dataset.py yard --hour 12 --out noon.npy                 # a lightmap: height x width x 3, float32
    read_dataset.py yard --hour 12 --layer sun --page 0 --out x.npy

As a module: s = Dataset('yard'); s.hours; s.light(12); s.layer('sun', 12); s.layer('porch', 21); s.mask(); where the parts of a light
are kept apart, s.layer('sun', 12, part='direct'), or 'indirect'
"""
import argparse, json, pathlib, struct, sys, zlib, numpy as np, OpenEXR

class Dataset:
    def __init__(self, folder):
        self.root = pathlib.Path(folder)
        layers = self.root / 'layers.json'  # in releases: what config.json says, and the layers
        self.config = json.loads((layers if layers.exists() else self.root / 'config.json').read_text('utf-8'))
        if self.config.get('format') != 'temporal-lightmaps' or self.config['version'] not in (1, 2):
            raise ValueError('not a temporal lightmap dataset of version 1 or 2')
        self.frames = self.config['frames' if self.config['version'] == 2 else 'sets']
        self.hours = [frame['hour'] for frame in self.frames]
    def data(self, file):
        data = (self.root / file['path']).read_bytes()
        if len(data) != file['bytes']:
            raise ValueError(f"{file['path']}: {len(data)} bytes; expected {file['bytes']}")
        return data
    def files(self, name, frame, page, part):
        """The files whose sum is a light in a frame, those that are black left out."""
        names, config = [group['name'] for group in self.config['groups']], self.config
        if name in names and not self.frames[frame]['groups_on'][names.index(name)]:
            return []
        if config['version'] == 1:  # one layer per light
            entry = self.frames[frame]['maps'][page]
            own = config['groups'][names.index(name)]['layers'][page:page + 1] if name in names else [entry.get(name)]
            return [file for file in own if file and part in (None, 'all')]
        if name == 'file':
            return [self.frames[frame]['maps'][page]]
        light = ('group', names.index(name)) if name in names else ('lamps' if name == 'local' else name, None)
        layers = [each for each in config['layers'] if (each['light'], each['group']) == light and part in (None, each['part'])]
        files = [each['files'][0 if name in names else frame][page] for each in layers]
        return [file for file in files if file]
    def light(self, hour, page=0): return self.layer('file', hour, page)
    def layer(self, name, hour, page=0, part=None):
        """'sun', 'sky', a light group, or 'local', the lamps of imported datasets. Black where it does not shine."""
        size = self.config['pages'][page]
        light = np.zeros((size['height'], size['width'], 3), np.float32)
        for file in self.files(name, self.hours.index(hour), page, part):
            self.data(file)
            with OpenEXR.File(str(self.root / file['path'])) as exr:
                light = light + np.asarray(exr.channels()['RGB'].pixels, np.float32)
        return light
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
        np.save(args.out, Dataset(args.folder).layer(args.layer, args.hour, args.page))
    except (ValueError, OSError, LookupError) as problem:
        sys.exit(f'{args.folder}: {problem}')
