"""Errors against references off the sun's shadow edges, and CPU seconds at equal error."""

import math

import numpy


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
