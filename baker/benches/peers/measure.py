"""Errors against references off the sun's shadow edges, CPU seconds at equal error, and what both comparisons share."""

import math
import resource

import numpy

# Texels along a cell, as in `bake::local`.
CELL = 16


def luminance(rgb):
    return rgb @ numpy.array([0.2126, 0.7152, 0.0722])


def neighbourhood(values, pick):
    """`pick` (numpy.minimum or numpy.maximum) over the 3 x 3 texels about each; past the page its border goes on."""
    padded = numpy.pad(values, 1, mode="edge")
    height, width = values.shape
    result = values
    for y in range(3):
        for x in range(3):
            result = pick(result, padded[y : y + height, x : x + width])
    return result


def judged(valid, direct_sun):
    """Texels that are valid with all their neighbours, among which the sun's direct light differs by less than 2 % of its
    greatest value on the page: off charts' borders and off the sun's shadow edges."""
    inside = neighbourhood(valid.astype(numpy.uint8), numpy.minimum) > 0
    inside[[0, -1]] = inside[:, [0, -1]] = False
    sun = luminance(direct_sun)
    spread = neighbourhood(sun, numpy.maximum) - neighbourhood(sun, numpy.minimum)
    return inside & (spread <= 0.02 * max(sun[valid].max(), 1e-12))


def relative_rmse(image, reference, mask, reference_noise=0.0):
    """Root of the mean squared difference over masked texels and channels, over the reference's mean.

    `reference_noise`: the reference's variance over the image's (0: exact), taken out of the result.
    """
    difference = image[mask] - reference[mask]
    return math.sqrt((difference**2).mean() / (1 + reference_noise)) / reference[mask].mean()


def charts(valid):
    """Per texel the number of the connected valid texels that it is among, diagonal neighbours included; 0 elsewhere."""
    numbers = numpy.where(valid, numpy.arange(1, valid.size + 1).reshape(valid.shape), 0)
    while True:
        spread = numpy.where(valid, neighbourhood(numbers, numpy.maximum), 0)
        if (spread == numbers).all():
            return numbers
        numbers = spread


def local_errors(image, reference, mask, charts, reference_noise=0.0):
    """The errors below which half and 95 % of the masked texels' cells are, as `bake::local` defines them, but without its
    floor for what is too dark to be seen.

    A texel's error is taken relative to the mean reference of its piece (its cell's texels on its chart), a cell's is the
    root mean square of its texels'. `reference_noise` as in `relative_rmse`.
    """
    rows, columns = numpy.nonzero(mask)
    cells = rows // CELL * (mask.shape[1] // CELL + 1) + columns // CELL
    _, piece = numpy.unique(cells * (charts.max() + 1) + charts[mask], return_inverse=True)
    count = numpy.bincount(piece)
    mean = numpy.bincount(piece, reference[mask].mean(axis=1)) / count
    squared = ((image[mask] - reference[mask]) ** 2).mean(axis=1) / (1 + reference_noise)
    squared /= numpy.maximum(mean, 1e-12)[piece] ** 2
    _, cell = numpy.unique(cells, return_inverse=True)
    texels = numpy.bincount(cell)
    error = numpy.sqrt(numpy.bincount(cell, squared) / texels)
    order = numpy.argsort(error)
    share = numpy.cumsum(texels[order]) / texels.sum()
    return tuple(error[order[min(numpy.searchsorted(share, part), len(order) - 1)]] for part in (0.5, 0.95))


def filled(image, valid):
    """With the mean of what is around where no texel is valid, outwards from those that are: no chart ends in black."""
    image, known = image.astype(numpy.float32), valid.copy()
    while not known.all():
        sums, counts = numpy.zeros_like(image), numpy.zeros(known.shape, numpy.float32)
        padded, around = numpy.pad(image * known[..., None], ((1, 1), (1, 1), (0, 0))), numpy.pad(known, 1)
        for y in range(3):
            for x in range(3):
                sums += padded[y : y + known.shape[0], x : x + known.shape[1]]
                counts += around[y : y + known.shape[0], x : x + known.shape[1]]
        new = ~known & (counts > 0)
        image[new] = sums[new] / counts[new][:, None]
        known |= new
    return numpy.ascontiguousarray(image)


def cpu_seconds():
    """User and system seconds of this process so far."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def agreement(a, b, mask):
    """Ratio of means of two references, and the RMS and median of their difference over the mean of the second."""
    difference = a[mask] - b[mask]
    mean = b[mask].mean()
    return {
        "mean_ratio": a[mask].mean() / mean,
        "rms_difference": math.sqrt((difference**2).mean()) / mean,
        "median_difference": float(numpy.median(numpy.abs(difference))) / mean,
    }


def cpu_at(error, points):
    """CPU seconds to reach an error, and whether that is between the measured points: piecewise linear in the logarithms
    through points (cpu, error), the end pieces continued; a single point with error ~ cpu^(-1/2)."""
    points = sorted(points, key=lambda p: p[1])
    if len(points) == 1:
        cpu, measured = points[0]
        return cpu * (measured / error) ** 2, error == measured
    inside = points[0][1] <= error <= points[-1][1]
    at = next((i for i in range(1, len(points)) if error <= points[i][1]), len(points) - 1)
    (c0, e0), (c1, e1) = points[at - 1], points[at]
    slope = math.log(c1 / c0) / math.log(e1 / e0)
    return c0 * (error / e0) ** slope, inside
