"""Tests of judge.py and perceived.py, on synthetic videos. Called by `judge.py --self-test`."""

import contextlib
import csv
import io
import json
import tempfile
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import scipy.ndimage

import judge
import perceived

SIZE = [64, 48]
FRAMES = 16
SEEN = [11, 15]
NO_LINK = 2**32 - 1


def check(claim, holds):
    if not holds:
        raise SystemExit(f"judges: self-test: {claim}: does not hold")


def close(claim, value, expected, tolerance):
    check(f"{claim}: {value:g} is {expected:g} +- {tolerance:g}", abs(value - expected) <= tolerance)


# ---- The metric once more, written for clarity: no FFT, no shared Gaussians. ----


def gaussian_mean(picture, terrain, deviation):
    reach = int(np.ceil(3 * deviation))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation) ** 2)
    sums = [np.where(terrain, picture, 0), terrain.astype(float)]
    for axis in (0, 1):
        sums = [scipy.ndimage.convolve1d(s, weights, axis=axis, mode="constant") for s in sums]
    return sums[0] / np.maximum(sums[1], 1e-300)


def plain_noise(errors, links, fps, ppd, centre=None, surround=None, time=None):
    """Perceived noise over the frames SEEN. `errors`: by frame, row and column. `links`: by frame and pixel."""
    time = time or perceived.CONSTANTS["TIME_CONSTANT_S"]
    centre, surround = centre or perceived.CONSTANTS["CENTRE_DEG"], surround or perceived.CONSTANTS["SURROUND_DEG"]
    share = 1 - np.exp(-1 / (fps * time))
    memory, age, noises = None, None, []
    for frame, (error, link) in enumerate(zip(errors.reshape(len(errors), -1), links)):
        now, ages = error.copy(), np.ones(error.size)
        for pixel in np.flatnonzero(link < NO_LINK - 1) if frame else []:
            ages[pixel] = age[link[pixel]] + 1
            weight = max(share, 1 / ages[pixel])
            now[pixel] = (1 - weight) * memory[link[pixel]] + weight * error[pixel]
        memory, age = now, ages
        if frame in SEEN:
            terrain = (link != NO_LINK - 1).reshape(errors.shape[1:])
            picture = memory.reshape(errors.shape[1:])
            band = gaussian_mean(picture, terrain, centre * ppd) - gaussian_mean(picture, terrain, surround * ppd)
            noises.append(np.sqrt(np.mean(band[terrain] ** 2)))
    return float(np.mean(noises))


# ---- The model. ----


def test_model():
    random = np.random.default_rng(1)
    width, height = 160, 120
    pixels = width * height
    still = np.tile(np.arange(pixels, dtype=np.uint32), (60, 1))
    still[0] = NO_LINK
    terrain = np.ones(pixels, bool)
    ppd, centre, surround = 67, 0.03, 0.1
    filters = perceived.Filters([width, height], [centre * ppd, surround * ppd])

    def noise(picture, terrain):
        means = filters.means(picture, terrain, filters.sums(terrain.astype(np.float32)))
        return float(perceived.difference(perceived.products(means), 0, 1))

    # An error that is the same everywhere does not count, even beside the sky.
    sky = (np.arange(pixels) % width) > 20 + np.arange(pixels) // width
    check("an offset is not noise", noise(np.full(pixels, 0.25), sky) < 1e-5)
    # The FFT gives the same numbers as a convolution, even at the borders.
    picture = random.normal(size=pixels)
    planes = [gaussian_mean(picture.reshape(height, width), sky.reshape(height, width), d * ppd) for d in (centre, surround)]
    plain = np.sqrt(np.mean((planes[0] - planes[1]).ravel()[sky] ** 2))
    close("filtered with an FFT", noise(picture, sky) / plain, 1, 1e-4)
    white = [noise(random.normal(size=pixels), terrain) for _ in range(4)]
    # Noise is smoothed less at the border. The mean of four times 160 x 120 squares, of which neighbours are correlated, scatters by about 1 %.
    close("the norm of the filter", np.mean(white) / filters.norm(0, 1), 1, 0.05)
    levels = random.uniform(0, 255, size=(2, pixels, 3))
    apart = perceived.luma(np.round(levels)) - perceived.luma(levels)
    close("rounding of two pictures", np.std(apart[0] - apart[1]) / perceived.rounding(), 1, 0.03)
    check("rounding explains a difference", judge.beyond(0.0101, 0.01, 0.002) == 0 and judge.beyond(0.0103, 0.01, 0.001) > 0.02)
    check("rounding explains no lower number", judge.beyond(0.0097, 0.01, 0.001) < -0.02 and judge.beyond(0.01, 0.01, 0) == 0)
    # For white noise in time, a share of a / (2 - a) of the variance is left, where a is the share of a new frame. 60 frames are 13 time constants,
    # so this limit is reached. The mean of 19 200 squares scatters by 1 %.
    share = perceived.adaptation(60, 0.075)
    errors = random.normal(size=(60, pixels)).astype(np.float32)
    left = perceived.remembered(errors, still, share)[-1].std()
    close("white noise in time", left / np.sqrt(share / (2 - share)), 1, 0.03)
    # An error that moves with the surface stays. The surface moves by a pixel per frame to the left, so links lead to the right.
    columns = np.arange(pixels) % width
    moving = np.tile(np.where(columns + 1 < width, np.arange(pixels) + 1, NO_LINK).astype(np.uint32), (20, 1))
    world = random.normal(size=(height, width + 20)).astype(np.float32)
    errors = np.stack([world[:, f : f + width].ravel() for f in range(20)])
    check("an error on the surface stays", np.allclose(perceived.remembered(errors, moving, share)[-1], errors[-1], atol=1e-6))
    # Without links, the memory contains only the current frame. With few frames, the memory is their mean.
    check("no link, no memory", np.array_equal(perceived.remembered(errors, np.full_like(moving, NO_LINK), share)[-1], errors[-1]))
    check("the mean of few frames", np.allclose(perceived.remembered(errors[:2], still, 0.01)[1], (errors[0] + errors[1]) / 2, atol=1e-6))
    check("the share of a frame", abs(perceived.adaptation(30, 0.1) - (1 - np.exp(-1 / 3))) < 1e-12)
    both = judge.gazes(np.array([[NO_LINK, 0, NO_LINK - 1]], dtype=np.uint32))
    check("a fixed gaze links each pixel to itself", both["fixed"].tolist() == [[0, 1, NO_LINK - 1]])
    check("a gaze along motion keeps the links", both["along motion"].tolist() == [[NO_LINK, 0, NO_LINK - 1]])


# ---- The judge. ----


def test_judge():
    random = np.random.default_rng(2)
    own = judge.judge_of(SIZE, 67)
    truth = np.full((FRAMES, SIZE[1], SIZE[0], 3), 120.0)
    truth += 40 * np.sin(np.arange(SIZE[0]) / 5)[None, None, :, None]

    def seen(amplitude, fps, frames):
        noise = random.normal(size=(frames, SIZE[1], SIZE[0], 1)) * amplitude
        return judge.jod(own, np.clip(truth + noise, 0, 255).astype(np.uint8), truth.astype(np.uint8), fps)

    close("the reference itself", judge.jod(own, truth.astype(np.uint8), truth.astype(np.uint8), 60), 10, 1e-3)
    weak, strong, fixed = seen(3, 60, FRAMES), seen(9, 60, FRAMES), seen(9, 60, 1)
    check(f"more noise is worse, and fixed noise worse than fresh noise: {weak} {strong} {fixed}", 10 > weak > strong > fixed)


# ---- A whole call. ----


def write_run(folder, fps, filmed, name, wrong=1.0):
    """Writes a run of synthetic videos. Every noise has its own strength. `filmed`: whether the videos are written, too. `wrong`: factor on the
    numbers of the metric; 1 = right.
    """
    views, noises, resolves, seeds = ["still", "moving"], {"fixed": 0.03, "fresh": 0.05}, {"off": 1.0, "exponential": 0.6}, ["0", "1"]
    ppd, [width, height] = 30, SIZE
    rows, pixels = [], width * height
    (folder / "pictures").mkdir(parents=True)
    sky = (np.arange(pixels) // width < 6).reshape(height, width)
    for view in views:
        step = int(view == "moving")
        world = 0.5 + 0.2 * np.sin(np.arange(width + FRAMES) / 4)
        truth = np.stack([np.tile(world[f * step : f * step + width], (height, 1)) for f in range(FRAMES)])
        columns = np.arange(pixels) % width
        link = np.where(columns + step < width, np.arange(pixels) + step, NO_LINK).astype(np.uint32)
        link[sky.ravel()] = NO_LINK - 1
        links = np.stack([np.where(link < NO_LINK - 1, NO_LINK, link), *[link] * (FRAMES - 1)]).astype(np.uint32)
        for resolve, strength in resolves.items():
            for seed in seeds:
                reference = folder / "video" / f"reference-{view}-{seed}-{resolve}"
                codes = np.round(255 * np.where(sky, 0, truth)).astype(np.uint8)
                if filmed:
                    write_frames(reference, codes, links if resolve == "off" else None)
                for noise, amplitude in noises.items():
                    random = np.random.default_rng([int(seed), step, len(noise), len(resolve)])
                    fresh = random.normal(size=(FRAMES, height, width + FRAMES))
                    errors = fresh[:, :, :width] if noise == "fresh" else np.stack([fresh[0, :, f * step :][:, :width] for f in range(FRAMES)])
                    test = np.round(255 * np.where(sky, 0, np.clip(truth + strength * amplitude * errors, 0, 1))).astype(np.uint8)
                    part = f"sweep-{view}-{noise}-{resolve}-{seed}"
                    if filmed:
                        own = folder / "video" / f"{part}-cliff"
                        write_frames(own, test, None)
                        (own / "judge.txt").write_text(f"cvvdp --test '../{own.name}/%04d.png' --ref '../{reference.name}/%04d.png' --fps {fps}\n")
                    key = {"view": view, "variant": "cliff", "noise": noise, "temporal": resolve, "setting": seed}
                    pictures = [{"file": f"{part}-cliff.png", "kind": kind, **key} for kind in ("frame", "residual-map")]
                    (folder / "pictures" / f"{part}.json").write_text(json.dumps(pictures))
                    value = wrong * plain_noise((test.astype(float) - codes) / 255, links, fps, ppd)
                    for frame in [*SEEN, None]:
                        rows.append({**key, "signal": "lit", "metric": "perceived_noise", "frame": frame, "lag": None, "value": value})
                    rows.append({**key, "signal": "lit", "metric": "residual", "frame": None, "lag": 1, "value": amplitude})
                    rows.append({**key, "signal": "lit", "metric": "residual", "frame": None, "lag": 2, "value": -1.0})
                    rows.append({**key, "signal": "albedo", "metric": "perceived_noise", "frame": None, "lag": None, "value": -1.0})
    pq.write_table(pa.Table.from_pylist(rows), folder / "metrics.parquet")
    definition = (
        f'name = "{name}"\nsize = [{width}, {height}]\nframes = {FRAMES}\nvideo = {str(filmed).lower()}\n'
        f"[viewing]\nframes_per_second = {fps}.0\npixels_per_degree = {ppd}.0\n"
    )
    manifest = {"definition": definition, "complete": True, "source_hash": "s", "identity": name, "adapter": "none", "version": "0"}
    (folder / "manifest.json").write_text(json.dumps(manifest))


def write_frames(folder, codes, links):
    folder.mkdir(parents=True, exist_ok=True)
    for frame, picture in enumerate(codes):
        iio.imwrite(folder / f"{frame:04}.png", np.repeat(picture[..., None], 3, axis=-1))
        if links is not None:
            links[frame].astype("<u4").tofile(folder / f"{frame:04}.links")


def call(*arguments):
    """Calls judge.py. Returns its message of failure, or an empty text."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said):
            judge.main([str(argument) for argument in arguments])
    except SystemExit as stop:
        return str(stop)
    return ""


def test_call(folder):
    fast, slow, out = folder / "fast", folder / "slow", folder / "record"
    write_run(fast, 60, True, "fast")
    write_run(slow, 30, False, "slow")
    said = call("--jobs", 2, "--out", out, fast, slow)
    check(f"a call succeeds: {said}", said == "")
    with open(out / "clips.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    check("a row for each clip", len(rows) == 2 * 2 * 2 * 2 and all(row["seeds"] == "2" for row in rows))
    halves = {row["clip"]: row["half"] for row in rows}
    check("frame rates of one group are in one half", all(halves[name] == halves[name[:-2] + "30"] for name in halves if name.endswith("60")))
    check("the halves are equal in size", sorted(halves.values()).count("fit") == len(rows) / 2)
    for axis in ("path", "noise", "resolve"):
        values = {(row[axis], row["half"]) for row in rows}
        check(f"each half has every {axis}", len(values) == 4)
    numbers = {row["clip"]: float(row["perceived_noise"]) for row in rows}
    check("noise that averages out counts less at 60 frames per second", numbers["still/cliff/fresh/off/60"] < numbers["still/cliff/fresh/off/30"])
    check("resolved noise is weaker", numbers["still/cliff/fixed/exponential/60"] < numbers["still/cliff/fixed/off/60"])
    text = (out / "README.md").read_text()
    check("the record names the judge and a metric", "ColorVideoVDP 0." in text and "`residual`" in text and "cvvdp==" in (out / "packages.txt").read_text())

    # A second call judges nothing again.
    kept = sorted((folder / "judged").iterdir())
    times = [file.stat().st_mtime_ns for file in kept]
    check("a second call succeeds", call("--jobs", 1, "--out", out, fast, slow) == "" and len(kept) == 16)
    check("what was judged is kept", [file.stat().st_mtime_ns for file in kept] == times)

    # If the rank correlation is below the goal, the record shows the clips that disagree most.
    judge.GOAL, goal = 2.0, judge.GOAL
    check("a call below the goal succeeds", call("--out", out, fast, slow) == "")
    text, pictures = (out / "README.md").read_text(), sorted(file.name for file in out.glob("*.png"))
    check("pictures of clips that disagree", len(pictures) == 4 and all(f"({name})" in text for name in pictures) and "does not reach" in text)
    check("three pictures side by side", iio.imread(out / pictures[0]).shape == (SIZE[1], 3 * SIZE[0], 3))
    judge.GOAL = goal

    # The call must fail if the model does not reproduce the numbers of the metric, and if runs do not belong together.
    write_run(folder / "wrong", 30, False, "wrong", wrong=1.05)
    check("a wrong number is noticed", "differs from the metric by up to 4." in call("--out", out, fast, folder / "wrong"))
    check("no videos", "none of the runs has videos" in call("--out", out, slow))
    check("a frame rate twice", "the same frame rate" in call("--out", out, fast, fast))
    manifest = json.loads((slow / "manifest.json").read_text())
    (slow / "manifest.json").write_text(json.dumps({**manifest, "definition": manifest["definition"].replace("frames = 16", "frames = 15")}))
    check("another definition", "differ in more than the frame rate" in call("--out", out, fast, slow))
    (slow / "manifest.json").write_text(json.dumps({**manifest, "complete": False}))
    check("an incomplete run", "is not complete" in call("--out", out, fast, slow))
    check("no run", "holds no run" in call("--out", out, folder / "nowhere"))


# ---- The fit. ----


def test_fit():
    """The quality of the clips is computed from perceived noise with known constants. The fit must find these constants."""
    random = np.random.default_rng(3)
    ppd, pixels = 30, SIZE[0] * SIZE[1]
    model = judge.Model(SIZE, ppd)
    rates = [30, 60]
    shares = judge.shares_of(rates)
    planted = (4, 6, 9)
    time, centre, surround = judge.TIMES_S[4], judge.DEVIATIONS_DEG[6], judge.DEVIATIONS_DEG[9]
    links = np.tile(np.arange(pixels, dtype=np.uint32), (FRAMES, 1))
    clips = []
    for blur in (0.0, 0.7, 1.5, 3.0):
        for fixed in (0.0, 0.3, 1.0):
            errors = random.normal(size=(FRAMES, SIZE[1], SIZE[0])) * (1 - fixed) + fixed * random.normal(size=(1, SIZE[1], SIZE[0]))
            errors = np.stack([scipy.ndimage.gaussian_filter(e, blur) for e in errors]) * 0.05 * (1 + blur)
            products = model.products(errors.reshape(FRAMES, -1).astype(np.float32), links, SEEN, shares)
            for fps in rates:
                noise = plain_noise(errors, links, fps, ppd, centre, surround, time)
                kept = {f"jod-{fps}": 10 - 20 * noise, f"model-{fps}": noise, **{f"products-{gaze}": products for gaze in judge.GAZES}}
                clips.append(judge.Clip(("view", "cliff", f"{blur}", f"{fixed}"), fps, [({"perceived_noise": noise, **dict.fromkeys(judge.OTHERS)}, kept)] * 2))
    check("planted constants are found", judge.fit(clips, judge.GAZES[0], shares) == planted)
    jods = [clip.jods.mean() for clip in clips]
    found = judge.with_constants(clips, judge.GAZES[0], shares, *planted)
    close("the rank correlation of the planted constants", judge.spearman(found, jods), 1, 1e-9)
    close("a predictor that is the quality", judge.spearman(jods, jods), -1, 1e-9)
    low, high = judge.interval(clips, random.normal(size=len(clips)))
    check(f"an interval of chance contains 0: {low} {high}", low < 0 < high)
    check("an interval of certainty is a point", np.allclose(judge.interval(clips, found), 1, atol=1e-9))


def main():
    test_model()
    test_judge()
    test_fit()
    with tempfile.TemporaryDirectory() as folder:
        test_call(Path(folder))
    print("judges: self-test passed")
    return 0
