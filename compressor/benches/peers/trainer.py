"""The main phase of `compress`'s recipe in PyTorch: milliseconds per step of 4096 samples, profile M, one thread.

F_uvt is read in one of two ways: `index`, interpolated in time for all sets and read by four index_select; `grid`, by
grid_sample in three dimensions. Prints one line of JSON per way: CPU milliseconds of the process per step.
"""
import argparse, json, os, time

os.environ['OMP_NUM_THREADS'] = os.environ['MKL_NUM_THREADS'] = '1'
import numpy as np
import torch
import torch.nn.functional as F

SIDE, SETS, U, SLICES, ROWS, HIDDEN, BATCH = 128, 26, 32, 12, 24, 16, 4096


def parameters(generator):
    rand = lambda *shape: torch.rand(*shape, generator=generator)
    blocks = lambda count: [0.3 + 0.2 * (rand(count, 4) - 0.5), 0.7 + 0.2 * (rand(count, 4) - 0.5), 0.5 + 0.2 * (rand(count, 16) - 0.5)]
    features = blocks(SIDE * SIDE // 16) + blocks(U * U // 16 * SLICES)
    features += [0.5 + 0.3 * (rand(ROWS, SIDE // 2, 2) - 0.5) for _ in range(2)]
    linear = lambda inputs, outputs: (2 * rand(outputs, inputs) - 1) * (3 / inputs) ** 0.5
    decoder = [linear(16, HIDDEN), torch.zeros(HIDDEN), linear(HIDDEN, HIDDEN), torch.zeros(HIDDEN), linear(HIDDEN, 3), torch.ones(3)]
    return [p.requires_grad_() for p in features], [p.requires_grad_() for p in decoder]


def axis(coordinate, size, wraps):
    """The two texels around each coordinate, and the second's share."""
    s = coordinate * size - 0.5
    if wraps:
        return (s.floor() % size).long(), ((s.floor() + 1) % size).long(), s - s.floor()
    s = s.clamp(0, size - 1)
    return s.long(), (s.long() + 1).clamp(max=size - 1), s - s.floor()


def matrix(coordinate, size, wraps):
    """Interpolation along an axis as a matrix."""
    i, j, share = axis(coordinate, size, wraps)
    out = torch.zeros(len(coordinate), size)
    out[range(len(out)), i] += 1 - share
    out[range(len(out)), j] += share
    return out


class Tile:
    """What does not change between steps: where texels and sets read the maps, and the targets."""

    def __init__(self):
        self.at, self.tau = (torch.arange(SIDE) + 0.5) / SIDE, (torch.arange(SETS) + 0.5) / SETS
        self.corners = axis(self.at, U, False)
        self.slices, self.rows = matrix(self.tau, SLICES, True), matrix(self.tau, ROWS, True)
        self.columns = matrix(self.at, SIDE // 2, False)
        angle = 2 * torch.pi * self.tau
        self.gamma = torch.stack([angle.sin(), angle.cos(), (2 * angle).sin(), (2 * angle).cos()], 1)
        y, x = torch.meshgrid(torch.arange(SIDE), torch.arange(SIDE), indexing='ij')
        light = [1 + 0.5 * torch.sin(0.05 * x + k) * torch.cos(0.04 * y) for k in range(SETS)]
        self.target = torch.stack(light).reshape(-1, 1).repeat(1, 3).sqrt()


def expand(first, second, weight, across):
    """Maps of blocks in rows: slices x rows x columns x 4."""
    texels = torch.lerp(first[:, None], second[:, None], weight[:, :, None])
    return texels.reshape(-1, across // 4, across // 4, 4, 4, 4).transpose(2, 3).reshape(-1, across, across, 4)


def read(way, features, tile, k, x, y):
    """The twelve features of each sample."""
    v_uv = expand(*features[:3], SIDE).reshape(-1, 4).index_select(0, y * SIDE + x)
    maps = expand(*features[3:6], U)
    if way == 'index':
        maps, v_uvt = (tile.slices @ maps.reshape(SLICES, -1)).reshape(-1, 4), 0
        (xi, xj, fx), (yi, yj, fy) = ([t.index_select(0, a) for t in tile.corners] for a in (x, y))
        for r, fr in (yi, 1 - fy), (yj, fy):
            for c, fc in (xi, 1 - fx), (xj, fx):
                v_uvt = v_uvt + (fr * fc)[:, None] * maps.index_select(0, (k * U + r) * U + c)
    else:
        # One slice more on each side makes the time axis periodic.
        maps = torch.cat([maps[-1:], maps, maps[:1]]).permute(3, 0, 1, 2)[None]
        depth = (tile.tau.index_select(0, k) * SLICES + 1) / (SLICES + 2)
        grid = torch.stack([tile.at.index_select(0, x), tile.at.index_select(0, y), depth], 1) * 2 - 1
        v_uvt = F.grid_sample(maps, grid[None, None, None], padding_mode='border', align_corners=False).reshape(4, -1).T
    planes = []
    for plane, a in (features[6], x), (features[7], y):
        sampled = tile.columns @ (tile.rows @ plane.reshape(ROWS, -1)).reshape(SETS, SIDE // 2, 2)
        planes.append(sampled.reshape(-1, 2).index_select(0, k * SIDE + a))
    return torch.cat([v_uvt, v_uv] + planes, 1)


def measure(way, steps, compiled):
    generator = torch.Generator().manual_seed(1)
    features, decoder = parameters(generator)
    tile = Tile()
    optimiser = torch.optim.Adam([{'params': features, 'lr': 0.02}, {'params': decoder, 'lr': 0.03}], betas=(0.9, 0.95), fused=True)
    total = SIDE * SIDE * SETS
    order = torch.randperm(total, generator=generator)

    def loss_of(features, decoder, samples):
        W1, b1, W2, b2, W3, b3 = decoder
        k, texel = samples >> 14, samples & SIDE * SIDE - 1
        x, y = texel & SIDE - 1, texel >> 7
        target = tile.target.index_select(0, samples)
        h = read(way, features, tile, k, x, y)
        h = 3 * (h + (torch.rand_like(h) - 0.5) / 255 - 0.5)
        h = torch.cat([h, tile.gamma.index_select(0, k)], 1)
        h = F.gelu(F.linear(h, W1, b1), approximate='tanh')
        h = F.gelu(F.linear(h, W2, b2), approximate='tanh')
        residual = F.linear(h, W3, b3) - target
        return ((0.1 + target) * residual * residual).mean()

    if compiled:
        loss_of = torch.compile(loss_of)
    losses, warm = [], 20
    for step in range(steps + warm):
        if step == warm:
            start = time.process_time()
        # Samples without replacement.
        first = step * BATCH % (total - BATCH)
        loss = loss_of(features, decoder, order[first:first + BATCH])
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        share = min(1, (step + 1) / 100) * (0.02 + 0.49 * (1 + np.cos(np.pi * step / (steps + warm))))
        for group, rate in zip(optimiser.param_groups, (0.02, 0.03)):
            group['lr'] = rate * share
        optimiser.step()
        with torch.no_grad():
            for p in features:
                p.clamp_(0, 1)
        losses.append(float(loss.detach()))
    milliseconds = 1e3 * (time.process_time() - start) / steps
    return {'way': way + (', compiled' if compiled else ''), 'ms': milliseconds, 'loss': [losses[0], float(np.mean(losses[-20:]))]}


if __name__ == '__main__':
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument('--steps', type=int, default=300)
    args.add_argument('--ways', nargs='+', choices=['index', 'grid'], default=['index', 'grid'])
    args.add_argument('--compile', action='store_true', help='through torch.compile (needs a C++ compiler)')
    args = args.parse_args()
    torch.set_num_threads(1)
    for way in args.ways:
        print(json.dumps(measure(way, args.steps, args.compile)), flush=True)
