"""The sun's direct light in NDGI bundles, written from ../FORMAT.md, section 8; read_ndgi.py uses it."""
from functools import cache
from pathlib import Path
import numpy as np

def check(holds, what):
    if not holds:
        raise ValueError(what)
def varint(data, at):
    check(at < len(data) and (data[at] < 128 or at + 1 < len(data)), 'tables of the sun end too early')
    return (data[at], at + 1) if data[at] < 128 else (data[at] & 127 | data[at + 1] << 7, at + 2)

@cache
def word(number):
    """What a word adds at the 13 ends of the steps of an interval, 4 rows and 4 columns, in sevenths."""
    packed = np.fromfile(Path(__file__).parent / '../ndgi/src/sun/words.bin', 'u1', 88, offset=88 * (number & 2047))
    values = np.stack([packed & 15, packed >> 4], 1).reshape(11, 4, 4).astype(int) - 7
    values = values[:, ::-1] if number >> 15 & 1 else values
    values = values[:, :, ::-1] if number >> 14 & 1 else values
    values = values.transpose(0, 2, 1) if number >> 13 & 1 else values
    values = values[::-1] if number >> 12 & 1 else values
    return np.pad(-values if number >> 11 & 1 else values, ((1, 1), (0, 0), (0, 0)))

def move(section, plane, planes, part, ends):
    """What a tile sees at a part of an interval, by its section of moving shadows and what it sees at the interval's ends."""
    height, width = ends[0].shape
    step = min(int(12 * part), 11)
    seen = [ends[0] + (ends[1] - ends[0]) * k / 12 for k in (step, step + 1)]
    borders, data = np.frombuffer(section, '<u4', planes), section[4 * planes:]
    check(len(borders) == planes and np.all(np.diff(np.int64(borders)) >= 0), 'planes of moving shadows')
    check(0 <= len(data) - 2 * int(borders[-1]) < 16 and not any(data[2 * int(borders[-1]):]), 'moving shadows are too long')
    data = data[2 * int(borders[plane - 1]) if plane else 0:2 * int(borders[plane])]
    across = -(-width // 32)
    groups = across * -(-height // 32) if data else 0
    at = groups + groups % 2
    for group, size in enumerate(data[:groups]):
        if size == 0:
            continue
        own, at = data[at:at + 2 * size], at + 2 * size
        modes = [int.from_bytes(own[:4], 'little') >> 2 * i & 3 for i in range(16)]
        told = sum((0, 0, 1, 2)[mode] for mode in modes)
        nibbles = [own[4 + i // 2] >> 4 * (i % 2) & 15 for i in range(told)]
        words = np.frombuffer(own, '<u2', offset=4 + 2 * -(-told // 4)).tolist()
        for i, mode in enumerate(modes):
            y0, x0 = 32 * (group // across) + 8 * (i // 4), 32 * (group % across) + 8 * (i % 4)
            if mode == 1:
                places = [(y0, x0, word(words.pop(0)).repeat(2, 1).repeat(2, 2))]
            else:
                bits, mode = [], mode - 1
                for _ in range(mode):
                    bits += [nibbles[0] >> k & 1 for k in range(4)] if mode == 1 else [nibbles[0] & 3, nibbles[0] >> 2]
                    nibbles = nibbles[1:]
                places = [(y0 + k // 2 * 4, x0 + k % 2 * 4, word(words.pop(0))) for k, count in enumerate(bits) for _ in range(count)]
            for y, x, values in places:
                for k in (0, 1):
                    own = seen[k][y:y + values.shape[1], x:x + values.shape[2]]
                    own[:] = np.clip(own + values[step + k][:own.shape[0], :own.shape[1]] / 7, 0, 1)
        check(not words and not nibbles, 'a group of moving shadows')
    check(at == len(data), 'a plane of moving shadows')
    part = 12 * part - step
    return seen[0] * (1 - part) + seen[1] * part

class Sun:
    def __init__(self, hours, to, light, times, data):
        self.hours, self.to, self.light, self.times = hours, to, light, times
        # The palette, and per context of modes and of patterns (symbol, bits, base) of each state.
        palette, modes, at = np.frombuffer(data, '<u2', 256), np.frombuffer(data, 'u1', 486, 512).reshape(162, 3), 998
        patterns = []
        for _ in range(81):
            frequencies, symbol = [0] * 259, 0
            n, at = varint(data, at)
            for _ in range(n):
                gap, at = varint(data, at)
                check(symbol + gap < 259, 'symbols of the sun')
                frequencies[symbol + gap], at = varint(data, at)
                symbol += gap + 1
            patterns.append(self.steps(frequencies, 10))
        check(at == len(data), 'tables of the sun')
        self.tables = palette, [self.steps(m, 7) for m in modes.tolist()], patterns
    @staticmethod
    def steps(frequencies, bits):
        check(sum(frequencies) == 1 << bits, 'frequencies of the sun')
        whole, at, symbols = 1 << bits, 0, [0] * (1 << bits)
        for symbol, frequency in enumerate(frequencies):
            for _ in range(frequency):
                symbols[at], at = symbol, at + whole // 2 + whole // 8 + 3 & whole - 1
        after, out = list(frequencies), []
        for symbol in symbols:
            count = bits + 1 - after[symbol].bit_length()
            out.append((symbol, count, (after[symbol] << count) - whole))
            after[symbol] += 1
        return out

    def plane(self, stream, height, width):
        """Levels of one tile at one time."""
        palette, modes, patterns = self.tables
        bits, at = int.from_bytes(stream, 'little'), 0
        def take(count):
            nonlocal at
            at += count
            return bits >> at - count & (1 << count) - 1
        down, across = -(-height // 8), -(-width // 8)
        x, z = take(7), take(10)
        def mode(context):
            nonlocal x
            symbol, count, base = modes[context][x]
            x = base + take(count)
            return symbol
        eight = np.zeros((down + 1, across + 2), int)  # a border of dark ones above and beside
        for r, c in np.ndindex(down, across):
            n = eight[r, c:c + 3]
            eight[r + 1, c + 1] = mode(eight[r + 1, c] + 3 * n[0] + 9 * n[1] + 27 * n[2])
        eight = eight[1:, 1:-1]
        four = np.pad(eight.repeat(2, 0).repeat(2, 1), ((1, 1), (1, 1)))
        four[-1], four[:, -1] = 2, 2
        four[0], four[:, 0] = 0, 0
        mixed = [(2 * r + i, 2 * c + j) for r, c in np.argwhere(eight == 2) for i in (0, 1) for j in (0, 1)]
        for r, c in mixed:
            four[r + 1, c + 1] = mode(81 + four[r + 1, c] + 3 * four[r, c + 1] + 9 * four[r + 1, c + 2] + 27 * four[r + 2, c + 1])
        four = four[1:-1, 1:-1]
        out = np.pad(7 * (four == 1).repeat(4, 0).repeat(4, 1), ((1, 0), (1, 0)))
        kind = np.array([0, 1, 1, 1, 1, 1, 1, 2])
        for r, c in mixed:
            for i, j in ((0, 0), (0, 2), (2, 0), (2, 2)) if four[r, c] == 2 else ():
                y, w = 4 * r + i + 1, 4 * c + j + 1
                left, up = kind[out[y:y + 2, w - 1]], kind[out[y - 1, w:w + 2]]
                symbol, count, base = patterns[27 * left[0] + 9 * left[1] + 3 * up[0] + up[1]][z]
                z = base + take(count)
                pattern = [0, 0xfff][symbol] if symbol < 2 else take(12) if symbol == 258 else int(palette[symbol - 2])
                out[y:y + 2, w:w + 2] = [[pattern & 7, pattern >> 3 & 7], [pattern >> 6 & 7, pattern >> 9]]
        check(x == z == 0 and 0 <= 8 * len(stream) - at < 8 and bits >> at == 0, 'levels of the sun do not end as they should')
        return out[1:1 + height, 1:1 + width]

    def tile(self, data, word, shadows, height, width, t):
        """The direct light on a tile, from its section, the word of its line in the index and its section of moving shadows: height x width x 3."""
        out, length = np.zeros((height, width, 3)), len(data)
        if length == 0:
            return out
        channels, count, times, at = word & 3, word >> 8 & 255, len(self.times), 0
        def take(size):
            nonlocal at
            at += size
            check(at <= length, 'a tile of the sun is too short')
            return data[at - size:at]
        def of(values): return np.array([np.interp(t, self.hours, axis) for axis in values.T])
        sizes = np.frombuffer(take(2 * channels * times), '<u2').reshape(channels, times)
        streams = [[take(size if size > 1 else 0) for size in row] for row in sizes.tolist()]
        before = min(max(int(np.searchsorted(self.times, t, 'right')) - 1, 0), times - 1)
        after = min(before + 1, times - 1) if t >= self.times[0] else 0
        span = self.times[after] - self.times[before]
        part = (t - self.times[before]) / span if span > 0 else 0
        def level(k, i):
            size = sizes[k, i]
            return self.plane(streams[k][i], height, width) if size > 1 else np.full((height, width), 7 * int(size))
        def seen_by(k):
            ends = [level(k, i) / 7 if channels else np.ones((height, width)) for i in (before, after)]
            if shadows and before < after:
                return move(shadows, k * (times - 1) + before, max(channels, 1) * (times - 1), part, ends)
            return ends[0] * (1 - part) + ends[1] * part
        seen = [seen_by(k) for k in range(max(channels, 1))]
        normals = self.normals(take, count, height, width) if word & 4 else np.zeros((height, width, 3))
        check(length - at < 16 and not any(data[at:]), 'a tile of the sun is too long')
        if not self.hours[0] <= t <= self.hours[-1]:
            return out
        return np.stack([seen[min(k, len(seen) - 1)] for k in range(3)], 2) * np.maximum(normals @ of(self.to), 0)[:, :, None] * of(self.light)

    @staticmethod
    def normals(take, count, height, width):
        palette, kinds, across = np.frombuffer(take(6 * count), '<i2').reshape(-1, 3) / 32767, [], width // 4
        while len(kinds) < height * width // 16:
            same, run, kind = take(3)
            check(same + run > 0 and (same == 0 or len(kinds) >= across), 'runs of normals')
            for _ in range(same):
                kinds.append(kinds[-across])
            kinds += [kind] * run
        check(len(kinds) == height * width // 16, 'runs of normals')
        def direction(two):
            u, v = np.maximum((np.array(two, float) - 128) / 127, -1)
            y = 1 - abs(u) - abs(v)
            under = max(-y, 0)
            n = np.array([u + (under if u < 0 else -under), y, v + (under if v < 0 else -under)])
            return n / np.linalg.norm(n)
        out = np.zeros((height, width, 3))
        for block, kind in enumerate(kinds):
            told, bits = {250: (1, 0), 251: (2, 1), 252: (2, 2), 253: (4, 2), 254: (8, 3), 255: (16, 0)}.get(kind, (0, 0))
            ends = [direction(two) for two in np.frombuffer(take(2 * told), 'u1').reshape(-1, 2)]
            if kind == 252:
                ends = [ends[0] * (1 - k / 3) + ends[1] * k / 3 for k in range(4)]
                ends = [end / np.linalg.norm(end) for end in ends]
            choice = int.from_bytes(take(2 * bits), 'little')
            texels = [ends[choice >> bits * i & (1 << bits) - 1 if bits else min(i, told - 1)] if told else palette[kind] for i in range(16)]
            y, x = block // across * 4, block % across * 4
            out[y:y + 4, x:x + 4] = np.reshape(texels, (4, 4, 3))
        return out
