#!/usr/bin/env python3
"""A second reader of NDGI bundles, written from ../FORMAT.md alone; numpy only (BLAKE3 stands in ../../dataset/python/blake3_numpy.py).

    read_ndgi.py scene.ndgi --hour 18.05 --out page.npy                # a page: height x width x 3, float32
    read_ndgi.py scene.ndgi --hour 12 --page 1 --tile 0,2 --out x.npy  # what tile (column, row) stores, with its border
"""
import argparse, pathlib, struct, sys, numpy as np
sys.path.append(str(pathlib.Path(__file__).parent / '../../dataset/python'))  # (or beside this file)
from blake3_numpy import checksum
from read_planes import light as light_of_planes
from read_sun import Sun

WEIGHTS = {2: np.array([0, 21, 43, 64]), 3: np.array([0, 9, 18, 27, 37, 46, 55, 64]),  # of indices of so many bits
           4: np.array([0, 4, 9, 13, 17, 21, 26, 30, 34, 38, 43, 47, 51, 55, 60, 64])}

def check(holds, what):
    if not holds:
        raise ValueError(what)

def bc7(data, columns):
    """Blocks of modes 6 and 4, `columns` in a row -> texels x 4 channels in 0 ... 1."""
    bits = np.unpackbits(data.view(np.uint8).reshape(-1, 16), axis=1, bitorder='little').astype(int)
    six = np.all(bits[:, :7] == [0, 0, 0, 0, 0, 0, 1], 1)
    check(np.all(six | np.all(bits[:, :5] == [0, 0, 0, 0, 1], 1)), 'a block is neither of BC7 mode 6 nor of mode 4')
    texels = np.empty((len(bits), 16, 4), int)
    def fields(b, at, count, width):
        return b[:, at:at + count * width].reshape(-1, count, width) @ (1 << np.arange(width))
    def weights(b, at, width):  # the top bit of texel 0 is not there
        return WEIGHTS[width][fields(np.insert(b, at + width - 1, 0, 1), at, 16, width)]
    def between(ends, weight): return (64 - weight) * ends[..., 0] + weight * ends[..., 1] + 32 >> 6
    b = bits[six]
    ends = 2 * fields(b, 7, 8, 7).reshape(-1, 1, 4, 2) + b[:, None, None, 63:65]
    texels[six] = between(ends, weights(b, 65, 4)[:, :, None])
    b = bits[~six]
    rgb, alone = fields(b, 8, 6, 5).reshape(-1, 1, 3, 2), fields(b, 38, 2, 6)[:, None]
    two, three, coarse = weights(b, 50, 2), weights(b, 81, 3), b[:, 7, None] == 1
    rgb = between(rgb << 3 | rgb >> 2, np.where(coarse, three, two)[:, :, None])
    alone = between(alone << 2 | alone >> 4, np.where(coarse, two, three))
    four = np.concatenate([rgb, alone[:, :, None]], 2)
    for rotation, order in enumerate([[0, 1, 2, 3], [3, 1, 2, 0], [0, 3, 2, 1], [0, 1, 3, 2]]):
        rotated = fields(b, 5, 1, 2)[:, 0] == rotation
        four[rotated] = four[rotated][:, :, order]
    texels[~six] = four
    return texels.reshape(-1, columns, 4, 4, 4).transpose(0, 2, 1, 3, 4).reshape(-1, 4 * columns, 4) / 255

def lerp(values, axis, i, j, share):
    share = np.reshape(share, [-1 if k == axis else 1 for k in range(values.ndim)])
    return values.take(i, axis) * (1 - share) + values.take(j, axis) * share
def stretch(values, axis, stored):  # a clamped axis, read at each stored texel
    s = np.clip((np.arange(stored) + 0.5) / stored * values.shape[axis] - 0.5, 0, values.shape[axis] - 1)
    return lerp(values, axis, s.astype(int), np.minimum(s.astype(int) + 1, values.shape[axis] - 1), s % 1)
def at_time(values, tau):  # the periodic first axis, read at tau
    s = tau * len(values) - 0.5
    return lerp(values, 0, [int(s // 1) % len(values)], [int(s // 1 + 1) % len(values)], s % 1)[0]

class Bundle:
    def __init__(self, path):
        self.data, self.at, self.index, self.suns = open(path, 'rb').read(), 0, {}, {}
        magic, version, end, length, digest = self.take('8sIIQQ')
        check(magic == b'NDGI\r\n\x1a\n', 'not an NDGI bundle')
        check(version == 5, f'bundle version {version}; this reader reads version 5: ' + ('compress its dataset again' if version < 5 else 'use a newer one'))
        check(end % 16 == 0 and 72 <= end <= min(2**28, length) and length == len(self.data), 'header damaged, or file truncated')
        check(checksum(self.data[:24] + self.data[32:end]) == digest, 'header damaged')
        side, border, self.n, between, pages, groups, streams, times, seen, sections = self.take('10I')
        check((side, border) == (128, 1), 'tile side or border unknown')
        check(self.n and pages, 'no frames, or no pages')
        self.scene, self.info, pages = self.text(), self.text(), [self.take('3I') for _ in range(pages)]
        check(all(kind < 2 and 1 <= W <= 2**20 and 1 <= H <= 2**20 for kind, W, H in pages), 'kind or size of a page')
        self.pages = [page[1:] for page in pages]
        self.hours, self.between = np.array(self.take(f'{self.n}d')), np.array(self.take(f'{between}d'))
        self.knots = np.sort(np.concatenate([self.hours, self.between]))
        ascend = lambda *lists: all(np.all(hours[1:] > hours[:-1]) for hours in lists)
        check(ascend(self.hours, self.between, self.knots) and 0 <= self.knots[0] and self.knots[-1] < 24, 'hours out of order')
        group = lambda: (self.text(), [self.take('2d') for _ in range(*self.take('I'))], np.array(self.take(f'{self.n}B')), *self.take('B'))
        self.groups = [group() for _ in range(groups)]
        check(all(max(*on, apart) <= 1 and all(0 <= x <= 24 for k in spans for x in k) for _, spans, on, apart in self.groups), 'light groups')
        self.apart = [g for g in range(groups) if self.groups[g][3]]
        self.switches = [spans for _, spans, _, apart in self.groups if not apart]  # what is apart switches nothing else
        self.states = np.array([on for _, _, on, apart in self.groups if not apart] or np.empty((0, self.n))).T > 0
        check(all(len(set(self.knots_at(hour)[:2])) == 2 for hour in self.between), 'an intermediate hour that is none')
        kinds = [self.take('3I') for _ in range(streams)]
        check(len({k[:2] for k in kinds}) == streams and ((0, 0, 1) in kinds) + ((3, 0, 1) in kinds) == sum(k[0] in (0, 3) for k in kinds) == 1, 'streams')
        check((3, 0, 1) in kinds or not self.apart, 'light groups apart from features')
        check(all(kind in (0, 1, 2, 3) or not flags & 1 for kind, _, flags in kinds), 'a stream that this reader does not know, and must')
        check(all(k[1:] == (0, 0) for k in kinds if k[0] in (1, 2)) and ((1, 0, 0) in kinds) == (times + seen > 0) and ((2, 0, 0) not in kinds or (1, 0, 0) in kinds), 'streams of the sun')
        table = [self.take('IIQQ') for _ in range(sections)]
        check(all(kind == 0 or not flags & 1 for kind, flags, *_ in table), 'a section that this reader does not know, and must')
        check(len({k[0] for k in table}) == sections and [k[1] for k in table if k[0] == 0] == [1], 'sections of the file')
        if times + seen:
            check(times and 0 < seen <= 1024, 'times of the sun')
            hours, seen = np.array(self.take(f'{times}d')), np.array(self.take(f'{seen}d'))
            to, light = (np.array(self.take(f'{3 * times}f')).reshape(-1, 3) for _ in range(2))
            check(ascend(hours, seen) and all(0 <= k[0] and k[-1] <= 24 for k in (hours, seen)), 'times of the sun out of order')
            check(np.all(np.linalg.norm(to, axis=1) < 1.0001) and np.all((light >= 0) & (light < np.inf)), 'directions or irradiances of the sun')
            self.light_of_sun = Sun(hours, to, light, seen, self.take(f"{self.take('I')[0]}s")[0])
        lines = []  # place, offset, and per stream length, word, checksum
        for page, (W, H) in enumerate(self.pages):
            for r, c in np.ndindex(-(-H // 126), -(-W // 126)):
                at = self.take('Q')
                lines.append(((page, c, r), at[0], [self.take('IIQ') for _ in kinds]))
        first, maps, suns = self.at, [k[0] in (0, 3) for k in kinds].index(True), {i: k[0] for i, k in enumerate(kinds) if k[0] in (1, 2)}
        check(0 <= end - first < 16 and not any(self.data[first:end]), 'header too long')
        self.planes = kinds[maps][0] == 3
        lit, offset, self.resident = sum(sections[maps][0] > 0 for *_, sections in lines), end, {}
        line = 8 + 8 * len(self.knots) + 8 * len(self.apart)
        for kind, _, length, digest in table:
            if kind == 0:
                end, whole = offset, self.data[offset:offset + length]
                check(len(whole) == length == lit * line and checksum(whole) == digest, 'resident block damaged')
            offset += (length + 15) // 16 * 16
        for place, at, sections in lines:
            check(at == offset, f'index line of tile {place}')
            if sections[maps][0]:
                self.resident[place] = self.data[end:end + line]
                end += line
            for i, (length, word, digest) in enumerate(sections):
                check(length % 16 == 0 and (length or digest == word == 0), f'index line of tile {place}')
                if i == maps:
                    self.index[place] = offset, length, word, digest
                elif i in suns:
                    self.suns[suns[i], *place] = offset, length, word, digest
                offset += length
        check(offset == len(self.data), 'payloads do not fill the file')

    def sun(self, page, c, r, hour):
        """Section 8: the sun's direct light on what a tile stores: height x width x 3."""
        (data, word), (shadows, zero) = (self.section(kind, page, c, r) for kind in (1, 2))
        check(zero == 0 and (data or not shadows), f'moving shadows of tile {c}, {r} of page {page}')
        try:
            return self.light_of_sun.tile(data, word, shadows, *self.stored(page, c, r), hour % 24 % 24)
        except LookupError as problem:
            raise ValueError(f'tile {c}, {r} of page {page}: its sun ends too early ({problem})')

    def section(self, kind, page, c, r):
        at, length, word, digest = self.suns.get((kind, page, c, r), (0, 0, 0, 0))
        check(length == 0 or checksum(self.data[at:at + length]) == digest, f'tile {c}, {r} of page {page} is damaged')
        return self.data[at:at + length], word

    def take(self, form):
        self.at += struct.calcsize('<' + form)
        check(self.at <= len(self.data), 'header is too short')
        return struct.unpack_from('<' + form, self.data, self.at - struct.calcsize('<' + form))
    def text(self): return self.take(f'{self.take("I")[0]}s')[0].decode()
    def stored(self, page, c, r):  # height and width of what a tile stores
        return [4 * -(-(min(126, side - 126 * at) + 2) // 4) for side, at in zip(self.pages[page][::-1], (r, c))]

    def knots_at(self, hour):
        """Section 4: sets a and b, knots i and j, and how far it is from the one to the other."""
        t, hours, n = hour % 24 % 24, self.hours, self.n  # (a tiny negative hour is 24 at first)
        state = np.array([self.on(spans, t) for spans in self.switches], bool)
        q = int(np.searchsorted(hours, t)) % n
        p, same = (q - 1) % n, lambda k: np.array_equal(self.states[k], state)
        if hours[q] != t and p != q and same(p) and same(q):
            i = int(np.searchsorted(self.knots, t, 'right')) - 1
            i, j = i % len(self.knots), (i + 1) % len(self.knots)
            return p, q, i, j, (t - self.knots[i]) % 24 / ((self.knots[j] - self.knots[i]) % 24)
        held = q if hours[q] == t else p if same(p) else q if same(q) else -1
        if held < 0:
            all_same, away = np.all(self.states == state, 1), np.minimum((hours - t) % 24, (t - hours) % 24)
            held = int(np.argmin(np.where(all_same | ~all_same.any(), away, np.inf)))
        knot = int(np.searchsorted(self.knots, hours[held]))
        return held, held, knot, knot, 0
    @staticmethod
    def on(spans, t): return any((x, y) == (0, 24) or (x < t < y if x <= y else t > x or t < y) for x, y in spans)

    def brightness(self, place):
        """A tile's means, of the knots and of light groups that are apart, and the knots' shares."""
        line, most = self.resident[place], np.finfo(np.float32).max
        scale, zero = struct.unpack_from('<fI', line)
        check(zero == 0 and 2.0**-126 <= scale <= most and np.frexp(scale)[0] == 0.5, f'scale of the means of tile {place}')
        means = np.frombuffer(line, '<f2').reshape(-1, 4)[1:, :3]
        check(np.all(np.isfinite(means)) and not np.signbit(means).any(), f'means of tile {place}')
        return np.minimum(means.astype(float) * scale, most).astype(np.float32).astype(float), np.frombuffer(line, 'u1')[15::8] / 255

    def between_knots(self, place, hour):
        """Frames a and b, b's share of the light, and the mean."""
        (a, b, i, j, g), (means, shares) = self.knots_at(hour), self.brightness(place)
        ends = (1 - g) * means[i].sum(), g * means[j].sum()
        of_b = shares[i], 1 if self.knots[j] == self.hours[b] else shares[j]
        share = (1 - g) * of_b[0] + g * of_b[1] if sum(ends) == 0 else (ends[0] * of_b[0] + ends[1] * of_b[1]) / sum(ends)
        return a, b, share, (1 - g) * means[i] + g * means[j]

    def tile(self, page, c, r, hour):
        """What a tile stores at an hour, border included: height x width x 3, float32."""
        length, direct = self.index[page, c, r][1], self.sun(page, c, r, hour) if self.suns else 0
        baked = (self.of_planes if self.planes else self.of_features)(page, c, r, hour) if length else np.zeros((*self.stored(page, c, r), 3))
        return np.minimum(baked + direct, np.finfo(np.float32).max).astype(np.float32)

    def of_planes(self, page, c, r, hour):
        """Section 9."""
        at, length, word, digest = self.index[page, c, r]
        check(checksum(self.data[at:at + length]) == digest, f'tile {c}, {r} of page {page} is damaged')
        (a, b, share, mean), means, t = self.between_knots((page, c, r), hour), self.brightness((page, c, r))[0], hour % 24 % 24
        lit = [frame for frame, knot in enumerate(np.searchsorted(self.knots, self.hours)) if means[knot].any()]
        places = [lit.index(frame) for frame in (a, b) if frame in lit]  # next to a black frame, the other counts alone
        sources, frame = {0: (len(lit), (places[0], places[-1], share, mean) if places else None)} if lit else {}, np.flatnonzero(self.hours == t)
        for g, own in zip(self.apart, means[len(self.knots):]):
            on = self.groups[g][2][frame[0]] if len(frame) else self.on(self.groups[g][1], t)
            sources[g + 1] = 1, (0, 0, 0, own) if on else None
        try:
            return light_of_planes(self.data[at:at + length], word, *self.stored(page, c, r), sources)
        except ValueError as problem:
            raise ValueError(f'tile {c}, {r} of page {page}: {problem}')

    def of_features(self, page, c, r, hour):
        """Sections 3 to 6."""
        (height, width), (at, length, word, digest) = self.stored(page, c, r), self.index[page, c, r]
        check(checksum(self.data[at:at + length]) == digest, f'tile {c}, {r} of page {page} is damaged')
        field = lambda k, bits=1: word >> k & (1 << bits) - 1
        (a, b, share, mean), n, end = self.between_knots((page, c, r), hour), self.n, at + length
        check((field(8, 7) > 0) == (field(4, 3) > 0) and (field(16, 8) > 0) == (field(1, 2) > 0) and field(4, 3) < 7, f'word of tile {c}, {r} of page {page}')
        def take(count, form='u1'):
            nonlocal at
            at += count * int(form[-1])
            check(at <= end, f'tile {c}, {r} of page {page} is too short')
            return np.frombuffer(self.data, form, count, at - count * int(form[-1]))
        def blocks(count, sparse):
            there = np.unpackbits(take(-(-count // 128) * 16), bitorder='little')[:count] > 0 if sparse else np.ones(count, bool)
            out = np.tile(np.array([64, 32, 16, 8, 4, 2, 129, 64] + 8 * [0], np.uint8), (count, 1))  # grey
            out[there] = take(16 * there.sum()).reshape(-1, 16)
            return out
        s = [-(-(-(-side * 2 * 2 ** field(4, 3) // 128)) // 4) for side in (height, width)]
        S, R, h = field(8, 7), field(16, 8), (16, 64, 32, 0)[field(7) + 2 * field(15)]
        uv = field(0) and blocks(height // 4 * (width // 4), field(30))
        uvt = field(4, 3) and blocks(s[0] * s[1] * S, field(31))
        axis = take(1 + n, '<u2').astype(int)
        turn = n + 1 - int(np.argmax(axis[:0:-1]))  # behind the last set on the largest place
        day = axis[1] == 0 and np.all(np.diff(axis[1:turn]) >= 0) and not axis[turn:].any() and axis[turn - 1] < axis[0]
        gates = take(field(24, 6), '<u2')
        ut, vt = (take(field(k) * R * (side // 2) * 2) for k, side in ((1, width), (2, height)))
        inputs = 4 * (field(4, 3) > 0) + 4 * field(0) + 2 * field(1) + 2 * field(2) + 4 * field(3) + len(gates)
        parts = [take(count, '<f2').astype(float) for count in (inputs * h, h, h * h, h, 3 * h, 3)]
        good = day and all(np.isfinite(p).all() for p in parts) and np.all(np.diff(gates.astype(int)) > 0) and not any(self.data[at:end])
        check(good and at + 15 & -16 == end and all(gates < len(self.groups)), f'tile {c}, {r} of page {page}: time axis, gates, decoder or length out of range')
        # The maps that there are, at this moment: height x width (or 1) x channels.
        tau = (axis[1:] + 0.5) / axis[0]
        tau, maps = tau[a] + share * ((tau[b] - tau[a]) % 1), []
        uvt = at_time(bc7(uvt, s[1]).reshape(S, 4 * s[0], 4 * s[1], 4), tau) if field(4, 3) else None
        maps += [stretch(stretch(uvt, 0, height), 1, width)] if field(4, 3) else []
        maps += [bc7(uv, width // 4)] if field(0) else []
        maps += [stretch(at_time(ut.reshape(R, -1, 2) / 255, tau), 0, width)[None]] if field(1) else []
        maps += [stretch(at_time(vt.reshape(R, -1, 2) / 255, tau), 0, height)[:, None]] if field(2) else []
        gamma = np.sin(np.pi * (2 * np.array([[[1, 1, 2, 2]]]) * tau + [0, 0.5, 0, 0.5]))
        gates = np.array([[[1.0 if self.groups[g][2][a] else -1.0 for g in gates]]])
        maps = [3 * (k - 0.5) for k in maps] + [gamma] * field(3) + [gates]
        x = np.concatenate([np.broadcast_to(k, (height, width, k.shape[2])) for k in maps], 2)
        for W, bias in zip(parts[::2], parts[1::2]):
            z = np.clip(y := x @ W.reshape(len(bias), -1).T + bias, -2.25, 2.25)
            x = y * (0.5 + z / 3 - 16 * z ** 3 / 729)
        return mean * np.clip(y, 0, 65504) ** 2

    def page(self, page, hour):
        out = np.empty(self.pages[page][::-1] + (3,), np.float32)
        for _, c, r in (k for k in self.index if k[0] == page):
            own = out[126 * r:126 * r + 126, 126 * c:126 * c + 126]
            own[:] = self.tile(page, c, r, hour)[1:1 + own.shape[0], 1:1 + own.shape[1]]
        return out
def hours(text): return sum(float(part) / 60 ** i for i, part in enumerate(text.split(':')))  # 18.05 or 18:03
if __name__ == '__main__':
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, kind in {'bundle': {}, '--hour': {'type': hours, 'required': True}, '--out': {'required': True},
                       '--page': {'type': int, 'default': 0}, '--tile': {'metavar': 'C,R'}}.items():
        args.add_argument(name, **kind)
    try:
        args = args.parse_args()
        check(np.isfinite(args.hour), f'--hour {args.hour}: expected hours, such as 18.05 or 18:03')
        bundle, tile = Bundle(args.bundle), tuple(map(int, args.tile.split(','))) if args.tile else (0, 0)
        check((args.page, *tile) in bundle.index, f'page {args.page}, tile {tile}: not in the bundle; the last is {max(bundle.index)}')
        np.save(args.out, bundle.tile(args.page, *tile, args.hour) if args.tile else bundle.page(args.page, args.hour))
    except (ValueError, OSError, struct.error, LookupError, MemoryError) as problem:
        sys.exit(f'{args.bundle}: {problem}')
