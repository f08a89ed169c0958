"""Light of planes in NDGI bundles, written from ../FORMAT.md, section 9; read_ndgi.py uses it."""
import struct, numpy as np

SHIFTS = (1, 2, 2, 3, 3, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5)
ORDER = [(d - i, i) if d % 2 == 0 else (i, d - i) for d in range(15) for i in range(d + 1)]  # of coefficients: row, column
ORDER = [8 * row + column for row, column in ORDER if max(row, column) < 8]
CODED = [sum(at // 8 + at % 8 < d for at in ORDER) for d in range(16)]  # coefficients of so many diagonals
LEVELS = [sum(least <= s for least in (1, 2, 3, 4, 5, 7, 9, 12, 16, 22, 30, 42, 60, 90, 140)) for s in range(15 * 13 + 1)]
COSINES = np.cos((2 * np.arange(8) + 1) * np.arange(8)[:, None] * np.pi / 16)
COSINES = np.rint(4096 * COSINES * np.where(np.arange(8) > 0, 0.5, 0.125 ** 0.5)[:, None]).astype(int)  # by k, n
COLOURS = np.array([[1, 1, 1], [1, 0, -1], [-1, 2, -1]]) / np.sqrt([[3], [2], [6]])  # by component, channel

def check(holds, what):
    if not holds:
        raise ValueError(what)
def contexts(*shape): return [contexts(*shape[1:]) for _ in range(shape[0])] if shape else [32768, 0]

class Code:
    """The range decoder."""
    def __init__(self, data):
        self.data, self.at, self.range = data, 4, 2**32 - 1
        self.code = int.from_bytes(data[:4].ljust(4, b'\0'), 'big')
    def widen(self):
        while self.range < 1 << 24:
            self.range <<= 8
            self.code = (self.code << 8 | (self.data[self.at] if self.at < len(self.data) else 0)) & 0xffffffff
            self.at += 1
    def bit(self, context):
        p, seen = context
        zero = (self.range >> 16) * min(max(p, 64), 65471)
        bit = self.code >= zero
        if bit:
            self.code, self.range, context[0] = self.code - zero, self.range - zero, p - (p >> SHIFTS[seen])
        else:
            self.range, context[0] = zero, p + (65535 - p >> SHIFTS[seen])
        context[1] = min(seen + 1, 15)
        self.widen()
        return bit
    def raw(self, count):
        value = 0
        for _ in range(count):
            self.range >>= 1
            bit = self.code >= self.range
            self.code -= self.range * bit
            value = 2 * value + bit
            self.widen()
        return value
    def number(self, contexts):
        n = 0
        while n < 29 and self.bit(contexts[min(n, 23)]):
            n += 1
        return (1 << n) - 1 + self.raw(n)
    def differences(self, contexts, count, least, most):
        """A series; `contexts` are lists of the first difference and of others."""
        values, value = [], 0
        for i in range(count):
            size = self.number(contexts[i > 0])
            value += -size if size and self.raw(1) else size
            check(least <= value <= most, f'a weight or factor of {value}')
            values.append(value)
        return values

def plane(code, tables, covered, across, before):
    """Coefficients of a plane's blocks. `before`: magnitudes and numbers of diagonals of the plane before, `None` in the first; and those of this plane."""
    nonzero, more, rest, diagonals = tables
    blocks, none = len(covered), [0] * 64
    values, sizes, counts = np.zeros((blocks, 64), int), [none] * blocks, [0] * blocks
    for i in range(blocks):
        if not covered[i]:
            continue
        beside = ([i - 1] if i % across else []) + ([i - across] if i >= across else [])
        under = before[1][i] if before else 0
        total = sum(counts[k] for k in beside) * (3 - len(beside)) if beside else 2 * under
        tree, node = diagonals[sum(total > k for k in (0, 2, 4, 7, 11, 16, 22))][min(under, 1) if under < 4 else 2], 1
        for _ in range(4):
            node = 2 * node + code.bit(tree[node])
        counts[i] = node - 16
        left, above = (sizes[beside[k]] if beside else none for k in (0, -1))  # past the edge, each is the other
        below, own = before[0][i] if before else none, [0] * 64
        for n, at in enumerate(ORDER[:CODED[counts[i]]]):
            near = (own[at - 1] if at % 8 else 0) + (own[at - 8] if at > 7 else 0)
            level = LEVELS[2 * near + 3 * (left[at] + above[at] + below[at])]
            if code.bit(nonzero[(n > 0) + (n > 5)][level]):
                size = 1
                while size < 15 and code.bit(more[size > 1][level]):
                    size += 1
                own[at] = size
                size = min(size + (code.number(rest) if size == 15 else 0), 32767)
                values[i, at] = -size if code.raw(1) else size
        sizes[i] = own
    return values, (sizes, counts)

def unpack(data, count, frames, down, across):
    """A set: by plane, component and frame the factors, as what y has of the plane; and the planes."""
    code, table = Code(data), contexts(4, 24)
    step, chroma, *scales = [code.raw(8) for _ in range(2 + count)]
    check(chroma > 0, 'colour weight of 0')
    weights = code.differences([table[0]] * 2, frames, -255, 0)
    series = lambda lists: [code.differences(lists, frames, -2**24, 2**24) for _ in range(3)]
    rows = [series(table[1:3]) for _ in range(count)]
    covered, of_covered = [], contexts(4)
    for i in range(down * across):
        left, above = i % across > 0 and covered[i - 1], i >= across and covered[i - across]
        covered.append(code.bit(of_covered[left + 2 * above]))
    tables, before, planes = (contexts(3, 16), contexts(2, 16), table[3], contexts(8, 3, 16)), None, []
    for _ in range(count):
        values, before = plane(code, tables, covered, across, before)
        planes.append(values)
    check(code.at >= len(data), 'a set of planes ends before its bytes')
    planes = np.array(planes, int).reshape(count, down, across, 8, 8)
    between = np.clip(COSINES.T @ planes + 128 >> 8, -131071, 131071)
    planes = np.clip(between @ COSINES + 2048 >> 12, -32767, 32767).transpose(0, 1, 3, 2, 4).reshape(count, 8 * down, 8 * across)
    rows = np.array(rows, float).reshape(count, 3, frames) * 2.0 ** (-np.array(scales, float) / 8)[:, None, None] * 2.0 ** (-np.array(weights) / 8)
    return rows * 2.0 ** (-step / 8) / 16 * np.array([1, 16 / chroma, 16 / chroma])[:, None], planes

def light(data, word, height, width, sources):
    """What a tile stores: height x width x 3. `sources`: by light source its frames and, if it is lit, (a, b, share of b, mean)."""
    out, down, across = np.zeros((height, width, 3)), -(-height // 8), -(-width // 8)
    count, = struct.unpack_from('<I', data)
    at, before, planes = 4 + 8 * count, -1, 0
    check(at <= len(data), 'too short for its sets of planes')
    for source, own, flags, length in struct.iter_unpack('<HBBI', data[4:at]):
        check(before < source in sources and own <= 64 and planes + own <= 1024 and flags < 2 and at + length <= len(data), f'light source {source}: its place, number of planes, flags or length')
        (frames, lit), before, planes = sources[source], source, planes + own
        rows, values = unpack(data[at:at + length], own, frames, down, across)
        at += length
        if lit:
            a, b, share, mean = lit
            rows = np.einsum('kj,jc->kc', rows[:, :, a] * (1 - share) + rows[:, :, b] * share, COLOURS)
            y = np.einsum('kyx,kc->yxc', values[:, :height, :width], rows)
            out += mean * np.clip(y, 0, 65504) ** (1 if flags else 2)
    check(planes == word and len(data) - at < 16 and not any(data[at:]), 'sets of planes: their number or their end')
    return out
