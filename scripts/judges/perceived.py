"""Perceived noise in NumPy, from the frames and links that a run with videos keeps. It serves to fit the constants of the metric.

The metric itself is kernels/src/metrics/perceived.rs, with the mean over time in measure.wgsl. This model reads its constants from there, and judge.py
compares the numbers of both.
"""

import re
from pathlib import Path

import numpy as np
import scipy.fft

# The number of a pixel without terrain in a file of links; see `write_links` in experiments/src/runner/pictures.rs. The only larger number marks a
# pixel of terrain without a link.
NO_TERRAIN = 2**32 - 2

ROOT = Path(__file__).resolve().parents[2]


def constants():
    """The constants of the metric, by name."""
    text = (ROOT / "kernels/src/metrics/perceived.rs").read_text()
    found = {name: float(value) for name, value in re.findall(r"^(?:pub )?const (\w+): f64 = ([\d.]+);", text, re.M)}
    luminance = re.search(r"const LUMINANCE: \[f64; 3\] = \[([\d., ]+)\]", (ROOT / "kernels/src/base/colour.rs").read_text())
    missing = {"TIME_CONSTANT_S", "CENTRE_DEG", "SURROUND_DEG", "REACH"} - set(found)
    if missing or not luminance:
        raise SystemExit(f"judges: perceived.rs or colour.rs no longer has {sorted(missing) or 'LUMINANCE'}: adapt scripts/judges/perceived.py")
    found["LUMINANCE"] = [float(part) for part in luminance[1].split(",")]
    return found


CONSTANTS = constants()


def luma(frames):
    """Luma, 0 to 1, of pictures of 8-bit codes; the last axis holds red, green, blue."""
    return (frames @ np.array(CONSTANTS["LUMINANCE"]) / 255).astype(np.float32)


def rounding():
    """An upper limit of the standard deviation of the error that rounding two pictures to 8 bits adds to the difference of their luma. Where the
    pictures are equal, rounding adds no error.
    """
    return float(np.sqrt(2 * np.sum(np.square(CONSTANTS["LUMINANCE"])) / 12) / 255)


def adaptation(frames_per_second, time_constant_s):
    """The share of a new frame in the exponential mean."""
    return -np.expm1(-1 / (frames_per_second * time_constant_s))


def remembered(errors, links, share):
    """The remembered error of each frame. `errors`: by frame and pixel. `links`: the same shape; each is the index of a pixel of the frame before, or at
    least NO_TERRAIN. The value of a pixel without terrain has no meaning.
    """
    memory, frames = errors[0], np.ones_like(errors[0])
    result = [memory]
    for error, link in zip(errors[1:], links[1:]):
        linked = link < NO_TERRAIN
        source = np.where(linked, link, 0)
        frames = np.where(linked, frames[source] + 1, 1).astype(np.float32)
        weight = np.maximum(np.float32(share), 1 / frames)
        before = np.where(linked, memory[source], error)
        memory = before + (error - before) * weight
        result.append(memory)
    return result


class Filters:
    """Gaussians of several widths, applied to pictures of one size. Each is cut off and normalised over the terrain, as in the metric."""

    def __init__(self, size, deviations_px):
        """`size`: width and height. `deviations_px`: standard deviations, pixels."""
        self.size = size
        reach = [int(np.ceil(CONSTANTS["REACH"] * max(d, 0.1))) for d in deviations_px]
        self.padded = [scipy.fft.next_fast_len(n + max(reach), real=True) for n in (size[1], size[0])]
        self.transforms = []
        for deviation, far in zip(deviations_px, reach):
            steps = np.arange(-far, far + 1)
            weights = np.exp(-0.5 * (steps / max(deviation, 0.1)) ** 2)
            weights /= weights.sum()
            rows, columns = (np.zeros(n) for n in self.padded)
            np.add.at(rows, steps % self.padded[0], weights)
            np.add.at(columns, steps % self.padded[1], weights)
            # A symmetric kernel has a real transform.
            transform = np.outer(scipy.fft.fft(rows).real, scipy.fft.rfft(columns).real)
            self.transforms.append(transform.astype(np.float32))

    def sums(self, picture):
        """The weighted sums around each pixel, by Gaussian."""
        width, height = self.size
        whole = scipy.fft.rfft2(picture.reshape(height, width).astype(np.float32), self.padded)
        return [scipy.fft.irfft2(whole * t, self.padded)[:height, :width].ravel() for t in self.transforms]

    def norm(self, centre, surround):
        """The factor by which the difference of two Gaussians reduces the root mean square of white noise."""
        return float(np.sqrt(np.sum(scipy.fft.irfft2(self.transforms[centre] - self.transforms[surround], self.padded) ** 2)))

    def means(self, picture, terrain, weights):
        """The weighted means over the terrain around each pixel of terrain. `weights`: the sums of `terrain`."""
        sums = self.sums(np.where(terrain, picture, 0))
        return np.array([s[terrain] / w[terrain] for s, w in zip(sums, weights)])


def products(means):
    """For each pair of pictures, the mean of their product over pixels. The mean square of their difference follows from it: see `difference`."""
    return means @ means.T / means.shape[1]


def difference(gram, centre, surround):
    """The root mean square of the difference of two pictures, from their mean products. `gram`: its last two axes are the pictures."""
    square = gram[..., centre, centre] - 2 * gram[..., centre, surround] + gram[..., surround, surround]
    return np.sqrt(np.maximum(square, 0))
