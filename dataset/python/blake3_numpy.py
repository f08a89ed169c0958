"""BLAKE3 for the readers of datasets and bundles: by the package `blake3` where it is installed, else (its specification's section 2) in numpy."""
import sys, numpy as np
try:
    from blake3 import blake3
except ImportError:
    blake3 = None

IV = np.array([[0x6A09E667], [0xBB67AE85], [0x3C6EF372], [0xA54FF53A], [0x510E527F], [0x9B05688C], [0x1F83D9AB], [0x5BE0CD19]],
              np.uint32)
ORDER = [2, 6, 3, 10, 7, 0, 4, 13, 1, 11, 12, 5, 9, 14, 15, 8]
BATCH, LONG = 1 << 14, 32 << 20  # chunks side by side, for memory's sake; bytes that take some seconds
told = False

def compress(chain, words, counter, length, flags):
    """BLAKE3's compression of n blocks side by side: chain is 8 x n, words 16 x n, the rest n or one for all."""
    turn = lambda x, bits: x >> np.uint32(bits) | x << np.uint32(32 - bits)
    a, b, c, d = chain[:4], chain[4:], IV[:4], np.zeros((4, chain.shape[1]), np.uint32)
    d[0], d[2], d[3] = counter, length, flags
    for _ in range(7):
        for k, side in (0, -1), (8, 1):  # columns, then diagonals
            for x, r, s in (words[k:k + 8:2], 16, 12), (words[k + 1:k + 8:2], 8, 7):
                a = a + b + x
                d = turn(d ^ a, r)
                c = c + d
                b = turn(b ^ c, s)
            b, c, d = np.roll(b, side, 0), np.roll(c, 2, 0), np.roll(d, -side, 0)
        words = words[ORDER]
    return np.concatenate([a ^ c, b ^ d])

def chunks(data, first, is_all):
    """The chaining values of chunks of 1024 bytes, counted from `first`: 8 x n. `is_all`: there are no others."""
    count = max(1, -(-len(data) // 1024))
    words = np.frombuffer(bytes(data) + bytes(1024 * count - len(data)), '<u4').reshape(count, 16, 16)
    chain, size = np.repeat(IV, count, 1), np.clip(len(data) - 1024 * np.arange(count), 0, 1024)
    for k in range(16):
        flags = (k == 0) + np.where(size <= 64 * k + 64, 10 if is_all and count == 1 else 2, 0)
        after = compress(chain, words[:, k].T, first + np.arange(count), np.clip(size - 64 * k, 0, 64), flags)
        chain = np.where((size > 64 * k) | (k == 0), after, chain)
    return chain

def numpy_digest(data):
    """The 32 bytes of BLAKE3: chunks side by side, then a tree of pairs."""
    step, view = 1024 * BATCH, memoryview(data)
    chain = np.concatenate([chunks(view[at:at + step], at // 1024, len(data) <= step) for at in range(0, max(len(data), 1), step)], 1)
    while (pairs := chain.shape[1] // 2) > 0:
        both = np.concatenate([chain[:, 0:2 * pairs:2], chain[:, 1:2 * pairs:2]])
        above = compress(np.repeat(IV, pairs, 1), both, 0, 64, 12 if chain.shape[1] == 2 else 4)
        chain = np.concatenate([above, chain[:, 2 * pairs:]], 1)
    return chain[:, 0].astype('<u4').tobytes()

def digest(data):
    """The 32 bytes of BLAKE3. Where many bytes are verified without the package, stderr says so, once."""
    global told
    if blake3:
        return blake3(data).digest()
    if len(data) > LONG and not told:
        told = True
        print('note: checksums are verified in numpy, which takes seconds; `pip install blake3` makes it fast', file=sys.stderr)
    return numpy_digest(data)

def checksum(data):
    """A bundle's checksum: the first 8 bytes as a number."""
    return int.from_bytes(digest(data)[:8], 'little')
