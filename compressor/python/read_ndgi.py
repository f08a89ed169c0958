#!/usr/bin/env python3
"""A second reader of NDGI bundles, written from ../FORMAT.md alone; numpy only (BLAKE3 stands in blake3_numpy.py).

    read_ndgi.py scene.ndgi --hour 18.05 --out page.npy                # a page: height x width x 3, float32
    read_ndgi.py scene.ndgi --hour 12 --page 1 --tile 0,2 --out x.npy  # what tile (column, row) stores, with its border
"""
import argparse, struct, sys
import numpy as np
from blake3_numpy import checksum

WEIGHTS = np.array([0, 4, 9, 13, 17, 21, 26, 30, 34, 38, 43, 47, 51, 55, 60, 64])
GELU = [-5.1827092e-7, 2.8011605e-5, -6.3417493e-4, 0.007962516, -0.06293608, 0.39684325]  # of P, highest power first

def check(holds, what):
    if not holds:
        raise ValueError(what)

def bc7(data, columns):
    """Blocks of mode 6, `columns` in a row -> texels x 4 channels in 0 ... 1."""
    low, high = data.view('<u8').reshape(-1, 2).T
    check(np.all(low & 127 == 64), 'a block is not of BC7 mode 6')
    ends = (low[:, None] >> np.arange(7, 63, 7, dtype=np.uint64) & 127).reshape(-1, 1, 4, 2)
    ends = (2 * ends + np.stack([low >> 63, high & 1], 1)[:, None, None]).astype(int)
    index = high[:, None] >> np.arange(0, 64, 4, dtype=np.uint64) & 15
    index[:, 0] >>= 1
    weight = WEIGHTS[index][:, :, None]
    texels = (64 - weight) * ends[..., 0] + weight * ends[..., 1] + 32 >> 6
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
        self.data, self.at, self.index = open(path, 'rb').read(), 0, {}
        magic, version, end, length, digest = self.take('8sIIQQ')
        check(magic == b'NDGI\r\n\x1a\n' and version == 1, 'not an NDGI bundle of version 1')
        check(end % 16 == 0 and 64 <= end <= min(2**28, length) and length == len(self.data), 'header damaged, or file truncated')
        check(checksum(self.data[:24] + self.data[32:end]) == digest, 'header damaged')
        side, border, self.U, self.h, self.coding, self.n, pages, groups = self.take('8I')
        known = (self.U, self.h) in ((16, 16), (32, 16), (32, 64), (64, 16)) and self.coding in (0, 1)
        check((side, border) == (128, 1) and known, 'tile side, border, profile or coding unknown')
        self.scene, self.info = self.text(), self.text()
        self.pages = [self.take('2I') for _ in range(pages)]
        self.hours = np.array(self.take(f'{self.n}d'))
        check(np.all(np.diff(self.hours) > 0) and 0 <= self.hours[0] and self.hours[-1] < 24, 'hours out of order')
        group = lambda: (self.text(), [self.take('2d') for _ in range(*self.take('I'))], np.array(self.take(f'{self.n}B')))
        self.groups, offset = [group() for _ in range(groups)], end
        for page, (W, H) in enumerate(self.pages):
            for r, c in np.ndindex(-(-H // 126), -(-W // 126)):
                self.index[page, c, r] = at, length, zero, digest = self.take('QIIQ')
                full, offset = -(-sum(self.sizes(*self.stored(page, c, r))) // 16) * 16, offset + length
                good = at == offset - length and length in (0, full) and zero == 0 and (length or digest == 0)
                check(good, f'index line of tile {c}, {r} of page {page}')
        check(offset == len(self.data) and not any(self.data[self.at:end]), 'payloads do not fill the file')

    def take(self, form):
        self.at += struct.calcsize('<' + form)
        return struct.unpack_from('<' + form, self.data, self.at - struct.calcsize('<' + form))

    def text(self):
        return self.take(f'{self.take("I")[0]}s')[0].decode()

    def stored(self, page, c, r):  # height and width of what a tile stores
        return [4 * -(-(min(126, side - 126 * at) + 2) // 4) for side, at in zip(self.pages[page][::-1], (r, c))]

    def blocks(self, side):  # of F_uvt along a side: s(side) / 4
        return -(-(-(-side * self.U // 128)) // 4)

    def sizes(self, height, width):  # bytes of F_uv, F_uvt, means, F_ut, F_vt, decoder
        uvt, rows, h = 16 * self.blocks(height) * self.blocks(width) * min(12, -(-self.n // 2)), min(24, self.n), self.h
        return height * width, uvt, 12 * self.n, width * rows, height * rows, 2 * (16 * h + h + h * h + h + 3 * h + 3)

    def moment(self, hour):
        """Section 4: sets a and b, the share f of b, and the time coordinate."""
        t, hours, n, f = hour % 24, self.hours, self.n, 0
        inside = lambda x, y: (x, y) == (0, 24) or (x < t < y if x <= y else t > x or t < y)
        same = np.all([on == any(inside(*k) for k in spans) for _, spans, on in self.groups] + [np.ones(n, bool)], 0)
        q = int(np.searchsorted(hours, t)) % n
        p = (q - 1) % n
        if hours[q] == t:
            a = b = q
        elif same[p] and same[q] and p != q:
            a, b, f = p, q, (t - hours[p]) % 24 / ((hours[q] - hours[p]) % 24)
        elif same[p] or same[q]:
            a = b = p if same[p] else q
        else:
            away = np.minimum((hours - t) % 24, (t - hours) % 24)
            a = b = int(np.argmin(np.where(same | ~same.any(), away, np.inf)))
        tau = hours / 24 if self.coding else (np.arange(n) + 0.5) / n
        return a, b, f, tau[a] + f * (tau[b] + (b < a) - tau[a])

    def tile(self, page, c, r, hour):
        """What a tile stores at an hour, border included: height x width x 3, float32."""
        (height, width), (at, length, _, digest), h = self.stored(page, c, r), self.index[page, c, r], self.h
        if length == 0:
            return np.zeros((height, width, 3), np.float32)
        check(checksum(self.data[at:at + length]) == digest, f'tile {c}, {r} of page {page} is damaged')
        parts = np.split(np.frombuffer(self.data, np.uint8, length, at), np.cumsum(self.sizes(height, width)))
        (uv, uvt, means, ut, vt, net, rest), (a, b, f, tau) = parts, self.moment(hour)
        means, net = means.view('<f4').reshape(-1, 3).astype(float), net.view('<f2').astype(float)
        good = np.isfinite(means).all() and np.all(means >= 0) and np.isfinite(net).all() and not rest.any()
        check(good, f'tile {c}, {r} of page {page}: means, decoder or padding out of range')
        uv, s = bc7(uv, width // 4), self.blocks(width)
        uvt = bc7(uvt, s).reshape(-1, 4 * self.blocks(height), 4 * s, 4)
        uvt = stretch(stretch(at_time(uvt, tau), 0, height), 1, width)
        ut = stretch(at_time(ut.reshape(-1, width // 2, 2) / 255, tau), 0, width)[None]
        vt = stretch(at_time(vt.reshape(-1, height // 2, 2) / 255, tau), 0, height)[:, None]
        gamma = np.sin(np.pi * ((1 if self.coding else 2) * np.array([[[1, 1, 2, 2]]]) * tau + [0, 0.5, 0, 0.5]))
        maps = [3 * (k - 0.5) for k in (uvt, uv, ut, vt)] + [gamma]
        x = np.concatenate([np.broadcast_to(k, (height, width, k.shape[2])) for k in maps], 2)
        W1, b1, W2, b2, W3, b3 = np.split(net, np.cumsum([16 * h, h, h * h, h, 3 * h]))
        for W, bias in (W1, b1), (W2, b2), (W3, b3):
            z = np.clip(y := x @ W.reshape(len(bias), -1).T + bias, -3.65, 3.65)
            x = y * (0.5 + z * np.polyval(GELU, z * z))
        light = ((1 - f) * means[a] + f * means[b]) * np.clip(y, 0, 65504) ** (2.2 if self.coding else 2)
        return np.minimum(light, np.finfo(np.float32).max).astype(np.float32)

    def page(self, page, hour):
        out = np.empty(self.pages[page][::-1] + (3,), np.float32)
        for _, c, r in (k for k in self.index if k[0] == page):
            own = out[126 * r:126 * r + 126, 126 * c:126 * c + 126]
            own[:] = self.tile(page, c, r, hour)[1:1 + own.shape[0], 1:1 + own.shape[1]]
        return out

if __name__ == '__main__':
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument('bundle')
    args.add_argument('--hour', type=float, required=True)
    args.add_argument('--out', required=True)
    args.add_argument('--page', type=int, default=0)
    args.add_argument('--tile', metavar='C,R')
    args = args.parse_args()
    try:
        bundle = Bundle(args.bundle)
        tile = args.tile and bundle.tile(args.page, *map(int, args.tile.split(',')), args.hour)
        np.save(args.out, bundle.page(args.page, args.hour) if tile is None else tile)
    except (ValueError, OSError, struct.error, LookupError) as problem:
        sys.exit(f'{args.bundle}: {problem}')
