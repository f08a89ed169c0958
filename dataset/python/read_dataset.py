#!/usr/bin/env python3
"""Reads temporal lightmap datasets, version 2 of the format.  pip install numpy OpenEXR blake3 (without blake3: slower)

    read_dataset.py yard --hour 12 --out noon.npy                 # a lightmap: height x width x 3, float32
    read_dataset.py yard --hour 12 --layer sun --page 0 --out x.npy

As a module: s = Dataset('yard'); s.hours; s.light(12); s.layer('sun', 12); s.layer('porch', 21); s.mask(); where the parts of a light
are kept apart, s.layer('sun', 12, part='direct'), or 'indirect'; where the sun's visibility is kept, s.sun_direct(12.37), the sun's direct
light at any time, and what it is made of: s.visibility(12.37), s.normals(), s.sun(12.37). s.light_at(12.37) is the whole light at any hour.
"""
import argparse, json, lzma, pathlib, struct, sys, zlib, numpy as np, OpenEXR
from blake3_numpy import digest

class Dataset:
    def __init__(self, folder):
        self.root = pathlib.Path(folder)
        self.config = json.loads((self.root / 'config.json').read_text('utf-8'))
        if (self.root / 'layers.json').exists():  # in releases: what config.json says, and the layers; those that were unpacked
            whole = json.loads((self.root / 'layers.json').read_text('utf-8'))
            files = [file for each in whole['layers'] for row in each['files'] for file in row if file]
            self.config = whole if all((self.root / file['path']).exists() for file in files) else self.config
        version = self.config.get('version')
        if self.config.get('format') != 'temporal-lightmaps':
            raise ValueError(f'{self.root}: not a temporal lightmap dataset')
        if version != 2:
            what = 'use a newer one' if isinstance(version, int) and version > 2 else 'bake or import the dataset again'
            raise ValueError(f'{self.root}: format version {version}; this reader reads version 2; {what}')
        self.frames = self.config['frames']
        self.hours, self.verified = [frame['hour'] for frame in self.frames], set()
    def data(self, file):
        """The bytes of a file; each is compared with its checksum once."""
        data, wanted = (self.root / file['path']).read_bytes(), (file['path'], file['bytes'], file['blake3'])
        if len(data) != file['bytes']:
            raise ValueError(f"{file['path']}: {len(data)} bytes; expected {file['bytes']}")
        if wanted not in self.verified and digest(data).hex() != file['blake3']:
            raise ValueError(f"{file['path']}: another checksum than config.json says: the content changed")
        self.verified.add(wanted)
        return data
    def files(self, name, frame, page, part):
        """The files whose sum is a light in a frame (None: of a group, when it is on), those that are black left out."""
        names, config = [group['name'] for group in self.config['groups']], self.config
        if name not in names + ['file', 'sun', 'sky', 'local'] or part not in (None, 'direct', 'indirect', 'all'):
            raise ValueError(f"{name!r}, part {part!r}: expected 'sun', 'sky', 'local' or one of {names}; 'direct', 'indirect', 'all' or None")
        if name in names and frame is not None and not self.frames[frame]['groups_on'][names.index(name)]:
            return []
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
        if hour not in self.hours and hour is not None:
            raise ValueError(f'no frame at {hour} h: expected one of {self.hours}; light_at({hour}) is between frames')
        light = np.zeros((size['height'], size['width'], 3), np.float32)
        for file in self.files(name, None if hour is None else self.hours.index(hour), page, part):
            self.data(file)
            with OpenEXR.File(str(self.root / file['path'])) as exr:
                light = light + np.asarray(exr.channels()['RGB'].pixels, np.float32)
        return light
    def mask(self, page=0):
        """True on surfaces."""
        return png(self.data(self.config['pages'][page]['mask']))[:, :, 0] == 255
    def light_at(self, hour, page=0):
        """The light at any hour of the day: between frames by the curves of layers, the sun's direct light by its visibility."""
        n, config = len(self.hours), self.config
        if not 0 <= hour <= 24:
            raise ValueError(f'hour {hour}; expected 0 to 24')
        if 'sun_path' in config:
            self.sun(hour)  # which refuses hours that were not baked
        after = int(np.searchsorted(self.hours, hour, 'right'))
        ends = [(after - 1) % n, after % n]
        a, b = self.hours[ends[0]], self.hours[ends[1]]
        part = (hour - a) % 24 / ((b - a) % 24 or 24)
        def mix(name, which=None, curve=None, part=part):
            lights = [self.layer(name, self.hours[end], page, which) for end in ends]
            if not curve:
                return lights[0] * (1 - part) + lights[1] * part
            known = json.loads(self.data(curve))
            s, sa, sb = (np.array([np.interp(h, known['hours'], axis) for axis in np.transpose(known['values'])]) for h in (hour, a, b))
            part = np.where((sa > 0) & (sb > 0), part, np.where(sa > 0, 0, np.where(sb > 0, 1, part)))
            dark = (sa == 0) & (sb == 0)
            share = lambda end: np.where(dark, 1, s) / np.where(end > 0, end, 1)
            return lights[0] * (1 - part) * share(sa) + lights[1] * part * share(sb)
        def is_on(group):
            ends = [min(abs(x - hour), 24 - abs(x - hour)) for span in group['on'] for x in span]  # there it is off
            on = any(x < hour < y if x < y else x < hour or hour < y for x, y in group['on'])
            return [0, 24] in group['on'] or on and min(ends) >= 1e-6
        on = [is_on(group) for group in config['groups']]
        same = [self.frames[end]['groups_on'] == on for end in ends]  # lamps that are one layer: of the frame that shows these
        of_lamps = part if self.frames[ends[0]]['groups_on'] == self.frames[ends[1]]['groups_on'] else \
            {(True, False): 0, (False, True): 1}.get(tuple(same), int(part >= 0.5))
        names = [group['name'] for group in config['groups']]
        if not any(self.files(name, frame, page, None) for name in ['sun', 'sky', 'local'] + names for frame in range(n)):
            return mix('file', part=of_lamps)  # layers are not kept
        layers = config['layers']
        is_direct = lambda each: (each['light'], each['part']) == ('sun', 'direct')
        apart = 'visibility' in config and any(map(is_direct, layers))
        light = 0
        for each in layers:
            if each['light'] in ('sun', 'sky'):
                share = mix(each['light'], each['part'], each.get('curve'))
                if apart and is_direct(each):  # off the mask, where nothing is known of the sun, the layer has what is filled in
                    share = np.where(self.mask(page)[:, :, None], self.sun_direct(hour, page), share)
                light = light + share
        return light + mix('local', part=of_lamps) + sum(self.layer(name, None, page) for name, on in zip(names, on) if on)
    def sun(self, hour):
        """Mean direction towards the sun's disc, and its irradiance, from the first time of its path to the last."""
        path = json.loads(self.data(self.config['sun_path']))
        if not path['hours'][0] <= hour <= path['hours'][-1]:
            raise ValueError(f"hour {hour}; expected {path['hours'][0]} to {path['hours'][-1]}")
        between = lambda values: [np.interp(hour, path['hours'], axis) for axis in np.transpose(values)]
        return np.array(between(path['direction'])), np.array(between(path['irradiance']))
    def visibility(self, hour, page=0):
        """The part of the sun that texels see, 0 to 1: height x width x 3."""
        if 'visibility' not in self.config:
            raise ValueError("the dataset has no visibility of the sun: bake with [sun] visibility other than 'off'")
        data = self.data(self.config['visibility']['files'][page])
        width, height, top, count = struct.unpack_from('<4I', data, 8)
        if data[:8] != b'TLMVIS01':
            raise ValueError('not the visibility of a sun, version 01')
        hours = np.frombuffer(data, '<f8', count, 24)
        corners = [(x, y) for y in range(0, height, 128) for x in range(0, width, 128)]
        sizes = np.frombuffer(data, '<u4', 2 * len(corners), 24 + 8 * count).reshape(-1, 2)
        out, at = np.zeros((height, width, 3), np.float32), 24 + 8 * (count + len(corners))
        for (x, y), (length, channels) in zip(corners, sizes.tolist()):
            tile = out[y:y + 128, x:x + 128]
            if channels:
                levels = np.frombuffer(lzma.decompress(data[at:at + length]), np.uint8).reshape(channels, count, *tile.shape[:2])
                before = min(max(int(np.searchsorted(hours, hour, 'right')) - 1, 0), max(count - 2, 0))
                after = min(before + 1, count - 1)
                part = np.clip((hour - hours[before]) / (hours[after] - hours[before]), 0, 1) if after > before else 0
                tile[:] = np.moveaxis(levels[:, before] * (1 - part) + levels[:, after] * part, 0, 2) / top
            at += length
        return out
    def normals(self, page=0):
        """The mean normal of each texel, x, y (up), z; 0 where there is no surface."""
        return (png(self.data(self.config['visibility']['normals'][page])).astype(np.float32) - 32768) / 32767
    def sun_direct(self, hour, page=0):
        """The sun's direct light at any time of the bake: visibility x (normal . direction) x irradiance."""
        visibility, (direction, irradiance) = self.visibility(hour, page), self.sun(hour)
        return visibility * np.maximum(self.normals(page) @ direction, 0)[:, :, None] * irradiance
def png(data):
    """The samples of a PNG file, grey or RGB, of 8 or 16 bits. Its rows are zipped, in front of each the number of its filter."""
    at, packed = 8, b''
    width, height, bits, colour = struct.unpack_from('>2I2B', data, 16)
    while at < len(data):
        length, kind = struct.unpack_from('>I4s', data, at)
        packed, at = packed + data[at + 8:at + 8 + length] * (kind == b'IDAT'), at + 12 + length
    channels, size = {0: 1, 2: 3}[colour], bits // 8
    rows = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, -1)
    out = np.zeros((height + 1, width + 1, channels * size), np.uint8)  # with a black row above, a black column to the left
    for y, row in enumerate(rows, 1):
        kind, row, above = row[0], row[1:].reshape(width, -1), out[y - 1]
        out[y, 1:] = np.cumsum(row, axis=0, dtype=np.uint8) if kind == 1 else row + above[1:] * (kind == 2)
        for x in range(1, width + 1) if kind > 2 else []:
            a, b, c = out[y, x - 1].astype(int), above[x].astype(int), above[x - 1].astype(int)  # left, above, above left
            da, db, dc = abs(b - c), abs(a - c), abs(a + b - 2 * c)
            near = np.where((da <= db) & (da <= dc), a, np.where(db <= dc, b, c)) if kind == 4 else (a + b) // 2
            out[y, x] = (row[x - 1] + near) & 255
    return np.ascontiguousarray(out[1:, 1:]).view(f'>u{size}').reshape(height, width, channels)
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
