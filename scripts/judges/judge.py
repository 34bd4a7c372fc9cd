#!/usr/bin/env python3
"""Shows the videos of runs to ColorVideoVDP, and compares its verdicts with perceived noise. `make judges` calls it.

Usage: judge.py [--jobs N] [--work FOLDER] --out RECORD RUN...
       judge.py --self-test

RUN: folders of complete runs that measure `perceived_noise` of the lit picture. One has videos; the others are the same runs for other frame rates.
RECORD: receives clips.csv, packages.txt and README.md. FOLDER: keeps what was judged, so that a stopped call can be repeated.

A clip is a view, a variant, a noise, a temporal resolve and a frame rate. Its numbers are means over seeds.
"""

import argparse
import csv
import importlib.metadata
import json
import platform
import re
import sys
import tomllib
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from scipy import stats

import perceived

# ---- What the judge sees. ----

# The display of ColorVideoVDP's `standard_fhd`, but with the pixels per degree of the run: an sRGB screen in an office.
DISPLAY = {"Y_peak": 200, "contrast": 1000, "source_colorspace": "sRGB", "E_ambient": 250, "k_refl": 0.005}
# Share of a sequence, from its beginning, that the judge does not see, because a temporal resolve has no history there.
UNSEEN = 0.25

# ---- The fit. ----

# The constants that the fit tries for perceived noise: standard deviations of its Gaussians, degrees, and time constants of its mean over time,
# seconds. Both have steps of a factor of sqrt(2). Two steps are a factor of 2, so a new frame has the same share for a time constant at 30 frames per
# second as for half this time constant at 60.
DEVIATIONS_DEG = [0.005 * 2 ** (k / 2) for k in range(14)]
TIMES_S = [0.0125 * 2 ** (k / 2) for k in range(11)]
# Where the eye looks: along the exact motion of the surface, or at one point of the screen.
GAZES = ["along motion", "fixed"]
BOOTSTRAPS = 2000
GOAL = 0.9
# Largest relative difference between perceived noise by the model in perceived.py and by the metric itself, besides what the rounding of frames to
# 8 bits can explain.
TOLERANCE = 0.02
# Metrics that are compared with the judge besides perceived noise: at the last frame, or over all frames at a lag of 1.
OTHERS = ["flip", "rmse", "difference", "excess_difference", "residual", "residual_p95", "residual_rms", "added", "lost"]


def fail(text):
    raise SystemExit(f"judges: {text}")


# ---- Runs. ----

# The columns that identify a sequence. The last column contains the seed. The other columns identify a group of clips.
KEY = ("view", "variant", "noise", "temporal", "setting")


class Run:
    """A complete run, with its rows of the lit picture."""

    def __init__(self, folder):
        self.folder = Path(folder)
        manifest = self.folder / "manifest.json"
        if not manifest.is_file():
            fail(f"{folder} holds no run: give the folder of a run, where manifest.json is")
        self.manifest = json.loads(manifest.read_text())
        if not self.manifest["complete"]:
            fail(f"{folder} is not complete: continue it with `experiments run --resume`")
        self.definition = tomllib.loads(self.manifest["definition"])
        viewing = self.definition.get("viewing", {})
        self.fps, self.ppd = viewing.get("frames_per_second"), viewing.get("pixels_per_degree")
        table = pq.read_table(self.folder / "metrics.parquet")
        if "signal" not in table.column_names or self.fps is None or self.ppd is None:
            fail(f"{folder} was measured by an older version, without lit pictures: run its definition again")
        wanted = pc.and_(pc.equal(table["signal"], "lit"), pc.is_in(table["metric"], value_set=pa.array(["perceived_noise", *OTHERS])))
        self.values = {}
        for row in table.filter(wanted).to_pylist():
            if row["lag"] in (None, 1):
                key = tuple(row[name] for name in KEY)
                self.values.setdefault((key, row["metric"]), {})[row["frame"]] = row["value"]

    def over_frames(self, key, metric):
        """The value over all frames; if there is none, the value of the last frame that has one; `None` if no frame has one."""
        values = self.values.get((key, metric), {})
        return values.get(None, values[max(values)] if values and None not in values else None)

    def seen(self, key):
        """The frames at which perceived noise was measured."""
        return sorted(frame for frame in self.values.get((key, "perceived_noise"), {}) if frame is not None)

    def measured(self):
        """What must be equal in runs that differ only in frame rate: the definition without some keys, and the hash of the sources."""
        apart = ("name", "question", "analysis", "viewing", "video")
        return {name: value for name, value in self.definition.items() if name not in apart}, self.manifest["source_hash"]

    def sequences(self):
        """The sequences of frames: for each, its key, its folder, that of its reference, and that of the links."""
        found = {}
        for file in sorted((self.folder / "pictures").glob("sweep-*.json")):
            for picture in json.loads(file.read_text()):
                folder = self.folder / "video" / Path(picture["file"]).stem
                if picture["kind"] != "frame" or not folder.is_dir():
                    continue
                # The command for the judge names the reference of the sequence.
                reference = re.search(r"--ref '(.+)/%04d\.png'", (folder / "judge.txt").read_text())[1]
                reference = (folder / reference).resolve()
                links = reference.with_name(re.sub(f"{re.escape(picture['temporal'])}$", "off", reference.name))
                key = tuple(picture[name] for name in KEY)
                found[key] = (folder, reference, links)
        return found


def frames_of(folder, count):
    """The frames of a sequence, as codes of 8 bits."""
    frames = np.stack([iio.imread(folder / f"{frame:04}.png")[..., :3] for frame in range(count)])
    if (folder / f"{count:04}.png").exists():
        fail(f"{folder} has more than {count} frames: it belongs to another run")
    return frames


# ---- One sequence: the judge and the model. ----


def judge_of(size, ppd):
    """ColorVideoVDP for pictures of a size. It is loaded here, because importing it takes seconds."""
    import pycvvdp
    import torch

    torch.set_num_threads(1)
    return pycvvdp.cvvdp(
        display_photometry=pycvvdp.vvdp_display_photo_eotf(**DISPLAY),
        display_geometry=pycvvdp.vvdp_display_geometry(size, ppd=ppd),
        device=torch.device("cpu"),
        quiet=True,
    )


def jod(judge, test, reference, fps):
    """The quality of a video, in JOD; 10 = no difference."""
    import torch

    with torch.inference_mode():
        return float(judge.predict(test, reference, dim_order="FHWC", frames_per_second=fps)[0])


class Model:
    """The model of perceived noise (see perceived.py) for pictures of a size."""

    def __init__(self, size, ppd):
        own = [perceived.CONSTANTS["CENTRE_DEG"], perceived.CONSTANTS["SURROUND_DEG"]]
        self.exact = perceived.Filters(size, [d * ppd for d in own])
        self.grid = perceived.Filters(size, [d * ppd for d in DEVIATIONS_DEG])
        self.weights = {}

    def means(self, filters, picture, terrain):
        """The filtered picture, on terrain. Many sequences have the same terrain."""
        key = (id(filters), terrain.tobytes())
        if key not in self.weights:
            if len(self.weights) > 200:
                self.weights.clear()
            self.weights[key] = filters.sums(terrain.astype(np.float32))
        return filters.means(picture, terrain, self.weights[key])

    def noise(self, errors, links, seen, fps):
        """Perceived noise with the metric's own constants, the mean over the frames `seen`."""
        memory = perceived.remembered(errors, links, perceived.adaptation(fps, perceived.CONSTANTS["TIME_CONSTANT_S"]))
        of_frames = [perceived.products(self.means(self.exact, memory[f], links[f] != perceived.NO_TERRAIN)) for f in seen]
        return float(np.mean(perceived.difference(np.array(of_frames), 0, 1)))

    def products(self, errors, links, seen, shares):
        """Mean products of the remembered error, filtered by each Gaussian of the grid: by share of a new frame, by frame, and by two Gaussians."""
        result = []
        for share in shares:
            memory = perceived.remembered(errors, links, share)
            result.append([perceived.products(self.means(self.grid, memory[f], links[f] != perceived.NO_TERRAIN)) for f in seen])
        return np.array(result, dtype=np.float32)


def gazes(links):
    """The links for each gaze. A fixed gaze links each pixel to itself."""
    still = np.where(links == perceived.NO_TERRAIN, links, np.arange(links.shape[1], dtype=np.uint32))
    return {"along motion": links, "fixed": still}


def shares_of(rates):
    """The shares of a new frame for each frame rate and time constant, each once."""
    return sorted({round(float(perceived.adaptation(fps, time)), 12) for fps in rates for time in TIMES_S})


KEPT = {}


def look(task):
    """Judges one sequence at each frame rate, and filters its errors with each Gaussian and time constant of the grid."""
    size, ppd, count, rates, seen, folder, reference, links, kept, stamp = task
    if kept.exists():
        with np.load(kept) as stored:
            if str(stored["stamp"]) == stamp:
                return
    if "judge" not in KEPT:
        KEPT.update(judge=judge_of(size, ppd), model=Model(size, ppd))
    test, truth = frames_of(folder, count), frames_of(reference, count)
    first = int(count * UNSEEN)
    result = {f"jod-{fps}": jod(KEPT["judge"], test[first:], truth[first:], fps) for fps in rates}
    linked = np.stack([np.fromfile(links / f"{frame:04}.links", dtype="<u4") for frame in range(count)])
    if linked.shape[1] != size[0] * size[1]:
        fail(f"the links in {links} are not those of pictures of {size[0]} x {size[1]} pixels: remove the run and repeat it")
    errors = (perceived.luma(test) - perceived.luma(truth)).reshape(count, -1)
    for fps in rates:
        result[f"model-{fps}"] = KEPT["model"].noise(errors, linked, seen, fps)
    # The fit needs only every other frame of `seen`, counted from the last.
    for gaze, of_gaze in gazes(linked).items():
        result[f"products-{gaze}"] = KEPT["model"].products(errors, of_gaze, seen[::-2], shares_of(rates))
    part = kept.with_name(kept.name + ".tmp.npz")
    np.savez(part, stamp=stamp, **result)
    part.rename(kept)


# ---- Clips. ----


class Clip:
    """A clip: its numbers are means over seeds."""

    def __init__(self, key, fps, seeds):
        """`seeds`: for each seed, the values of the run by metric, and the results that `look` stored."""
        self.view, self.variant, self.noise, self.resolve = key
        self.fps = fps
        self.group = key
        self.seeds = len(seeds)
        self.jods = np.array([float(kept[f"jod-{fps}"]) for _, kept in seeds])
        self.noises = np.array([value["perceived_noise"] for value, _ in seeds])
        self.models = np.array([float(kept[f"model-{fps}"]) for _, kept in seeds])
        self.products = {gaze: np.array([kept[f"products-{gaze}"] for _, kept in seeds]) for gaze in GAZES}
        self.others = {m: np.mean([v[m] for v, _ in seeds]) for m in OTHERS if all(v[m] is not None for v, _ in seeds)}
        self.half = ""

    @property
    def name(self):
        return f"{self.view}/{self.variant}/{self.noise}/{self.resolve}/{self.fps:g}"

    def fitted(self, gaze, share, centre, surround):
        """Perceived noise with other constants, the mean over seeds. `share`: index of the share of a new frame."""
        return perceived.difference(self.products[gaze][:, share], centre, surround).mean()


def mean_and_error(values):
    """The mean over seeds and its standard error."""
    return values.mean(), (values.std(ddof=1) / np.sqrt(len(values)) if len(values) > 1 else float("nan"))


def split(clips):
    """Puts each clip into the half `fit` or `held-out`. Clips that differ only in the frame rate show the same frames, so they are in one half. The
    groups of clips form a chequerboard over view, variant, noise and resolve, so each half has about as many of each.
    """
    places = [sorted({clip.group[axis] for clip in clips}) for axis in range(4)]
    for clip in clips:
        place = sum(places[axis].index(clip.group[axis]) for axis in range(4))
        clip.half = "fit" if place % 2 == 0 else "held-out"


def spearman(noise, jods):
    """The rank correlation between more noise and lower quality; NaN if all clips have the same noise or the same quality."""
    return float(stats.spearmanr(noise, -np.asarray(jods))[0]) if np.ptp(noise) > 0 and np.ptp(jods) > 0 else float("nan")


def interval(clips, noise, seed=1):
    """An interval of 95 % of the rank correlation: percentiles over samples of groups of clips, with replacement."""
    groups = {}
    for index, clip in enumerate(clips):
        groups.setdefault(clip.group, []).append(index)
    groups = list(groups.values())
    random = np.random.default_rng(seed)
    noise, jods = np.asarray(noise), np.array([clip.jods.mean() for clip in clips])
    found = []
    for _ in range(BOOTSTRAPS):
        chosen = np.concatenate([groups[i] for i in random.integers(len(groups), size=len(groups))])
        found.append(spearman(noise[chosen], jods[chosen]))
    # If a sample contains only one group, all its clips may be equal, and its correlation is then NaN. Such samples are ignored.
    return tuple(np.nanpercentile(found, [2.5, 97.5])) if np.isfinite(found).any() else (float("nan"), float("nan"))


def with_constants(clips, gaze, shares, time, centre, surround):
    """Perceived noise of each clip. `time`, `centre`, `surround`: indices of the grid."""
    return np.array(
        [c.fitted(gaze, shares.index(round(float(perceived.adaptation(c.fps, TIMES_S[time])), 12)), centre, surround) for c in clips]
    )


def fit(clips, gaze, shares):
    """The constants of the grid that predict the judge best: indices of time constant, centre and surround. Only constants whose rank correlation is
    at most 0.002 below the largest are considered. Of these, the constants are best for which the logarithm of perceived noise correlates most with
    the logarithm of the lost quality.
    """
    jods = np.array([clip.jods.mean() for clip in clips])
    lost = np.log(np.maximum(10 - jods, 1e-6))
    tried = []
    for time in range(len(TIMES_S)):
        for centre in range(len(DEVIATIONS_DEG)):
            for surround in range(centre + 1, len(DEVIATIONS_DEG)):
                noise = with_constants(clips, gaze, shares, time, centre, surround)
                # Two Gaussians that are both much narrower than a pixel are equal. Their difference is 0, so these constants are left out.
                if noise.min() > 0:
                    tried.append((spearman(noise, jods), float(np.corrcoef(np.log(noise), lost)[0, 1]), (time, centre, surround)))
    if not tried:
        fail("no constants give noise in every clip: is a clip equal to its reference?")
    best = max(rank for rank, _, _ in tried)
    return max((linear, constants) for rank, linear, constants in tried if rank >= best - 0.002)[1]


def beyond(model, metric, rounding):
    """The relative difference between the model and the metric that rounding does not explain. `rounding`: root mean square that it can add."""
    most = float(np.hypot(metric, rounding))
    return (model - np.clip(model, metric, most)) / max(most, 1e-12)


def disagreement(clips, noise):
    """For each clip its rank by noise less its rank by lost quality, both from 1 = best."""
    jods = np.array([clip.jods.mean() for clip in clips])
    return stats.rankdata(noise) - stats.rankdata(-jods)


# ---- The record. ----


def table(heading, rows):
    return "\n".join([f"| {' | '.join(heading)} |", f"|{' --- |' * len(heading)}", *(f"| {' | '.join(row)} |" for row in rows)]) + "\n"


def rank_row(label, clips, noise):
    """A row: label, then the rank correlation with its interval over all clips and in each half."""
    row = [label]
    for half in ("fit", "held-out", ""):
        at = [i for i, clip in enumerate(clips) if half in ("", clip.half)]
        chosen = [clips[i] for i in at]
        of = np.asarray(noise)[at]
        low, high = interval(chosen, of)
        row.append(f"{spearman(of, [c.jods.mean() for c in chosen]):.3f} ({low:.3f} to {high:.3f})")
    return row


def write_csv(file, clips, shares, best):
    with open(file, "w", newline="") as output:
        writer = csv.writer(output, lineterminator="\n")
        columns = "clip path variant noise fps resolve seeds jod jod_se perceived_noise perceived_noise_se fitted_noise half"
        writer.writerow(columns.split())
        fitted = with_constants(clips, GAZES[0], shares, *best)
        for clip, of_fit in zip(clips, fitted):
            numbers = [*mean_and_error(clip.jods), *mean_and_error(clip.noises), of_fit]
            texts = [f"{value:.6g}" for value in numbers]
            writer.writerow([clip.name, clip.view, clip.variant, clip.noise, f"{clip.fps:g}", clip.resolve, clip.seeds, *texts, clip.half])


def write_pictures(out, run, clips, noise, count):
    """For each of the groups of clips on which metric and judge disagree most, writes one picture: the last frame of the first seed, that of the
    reference, and four times the error, where grey is 0. Returns the names of the files.
    """
    sequences = run.sequences()
    frames = run.definition["frames"]
    names = []
    order = np.argsort(-np.abs(disagreement(clips, noise)), kind="stable")
    for group in list(dict.fromkeys(clips[index].group for index in order))[:count]:
        key = next(key for key in sequences if key[:4] == group)
        folder, reference, _ = sequences[key]
        test, truth = (iio.imread(f / f"{frames - 1:04}.png")[..., :3].astype(int) for f in (folder, reference))
        error = np.clip(128 + 4 * (test - truth), 0, 255)
        name = f"{'_'.join(group)}.png"
        iio.imwrite(out / name, np.concatenate([test, truth, error], axis=1).astype(np.uint8))
        names.append(name)
    return names


def record(out, run, runs, clips, shares, command):
    """Writes the record. Returns the rank correlation on held-out clips, whether the model agrees with the metric, and their largest relative
    difference that rounding does not explain.
    """
    out.mkdir(parents=True, exist_ok=True)
    packages = sorted(f"{d.metadata['Name']}=={d.version}" for d in importlib.metadata.distributions())
    (out / "packages.txt").write_text("\n".join(packages) + "\n")
    metric = np.array([clip.noises.mean() for clip in clips])
    halves = {half: [clip for clip in clips if clip.half == half] for half in ("fit", "held-out")}
    best = {gaze: fit(halves["fit"], gaze, shares) for gaze in GAZES}
    write_csv(out / "clips.csv", clips, shares, best[GAZES[0]])

    own = [perceived.CONSTANTS[name] for name in ("TIME_CONSTANT_S", "CENTRE_DEG", "SURROUND_DEG")]
    constants = [["the metric's own", *(f"{value:g}" for value in own)]]
    ranks = [rank_row("perceived noise", clips, metric)]
    for gaze in GAZES:
        time, centre, surround = best[gaze]
        fitted = with_constants(clips, gaze, shares, time, centre, surround)
        constants.append([f"fitted, gaze {gaze}", f"{TIMES_S[time]:.4f}", f"{DEVIATIONS_DEG[centre]:.4f}", f"{DEVIATIONS_DEG[surround]:.4f}"])
        ranks.append(rank_row(f"fitted, gaze {gaze}", clips, fitted))
    others = [rank_row(f"`{m}`", clips, [clip.others[m] for clip in clips]) for m in OTHERS if all(m in clip.others for clip in clips)]
    rounding = Model(run.definition["size"], run.ppd).exact.norm(0, 1) * perceived.rounding()
    apart = np.array([beyond(clip.models.mean(), clip.noises.mean(), rounding) for clip in clips])
    agrees = bool(np.abs(apart).max() <= TOLERANCE)

    ratios = np.array([clip.models.mean() / max(clip.noises.mean(), 1e-12) for clip in clips])
    held = [i for i, clip in enumerate(clips) if clip.half == "held-out"]
    reached = spearman(metric[held], [clips[i].jods.mean() for i in held])
    ranked = disagreement(clips, metric)
    rows = [
        [clips[i].name, f"{clips[i].jods.mean():.3f}", f"{metric[i]:.5f}", f"{ranked[i]:+.1f}", clips[i].half]
        for i in np.argsort(-np.abs(ranked), kind="stable")[:10]
    ]
    pictures = [] if reached >= GOAL else write_pictures(out, run, clips, metric, 4)
    shown = "".join(f"![{name}]({name})\n" for name in pictures)
    if pictures:
        shown = "Pictures: the last frame of a clip, the same of the reference sequence, and four times the error (grey = 0).\n\n" + shown
    definition = run.definition
    within = []
    for view in sorted({clip.view for clip in clips}):
        at = [i for i, clip in enumerate(clips) if clip.view == view]
        within.append([view, str(len(at)), f"{spearman(metric[at], [clips[i].jods.mean() for i in at]):.3f}", f"{np.mean(ranked[at]):+.1f}"])
    verdict = "reaches" if reached >= GOAL else "does not reach"
    (out / "README.md").write_text(
        f"""# Perceived noise and ColorVideoVDP

Does `perceived_noise` rank clips as a judge does that we did not write? On the held-out clips, the rank correlation (Spearman) between perceived
noise and the quality that ColorVideoVDP predicts is {reached:.3f}, which {verdict} the goal of {GOAL}.

`make judges` wrote this record: `{command}`.

| what | value |
| --- | --- |
| judge | ColorVideoVDP {importlib.metadata.version('cvvdp')} (package `cvvdp`), PyTorch {importlib.metadata.version('torch')}, on the CPU; Python {platform.python_version()}; all packages are in `packages.txt` |
| display | sRGB, {DISPLAY['Y_peak']} cd/m², contrast {DISPLAY['contrast']}:1, ambient light {DISPLAY['E_ambient']} lux, reflectivity {DISPLAY['k_refl']:.1%} (those of `standard_fhd`); {run.ppd:g} pixels per degree |
| clips | {len(clips)}: {len(halves['fit'])} to fit, {len(halves['held-out'])} held out; {min(c.seeds for c in clips)} seeds each; {definition['size'][0]}x{definition['size'][1]} pixels, {definition['frames']} frames, of which the judge sees the last {definition['frames'] - int(definition['frames'] * UNSEEN)} |
| frames per second | {', '.join(f'{r.fps:g}' for r in runs)}: the same frames, at different rates |
| pictures | the lit picture against the reference sequence of the same temporal resolve |
| runs | adapter {run.manifest['adapter']}, version {run.manifest['version']}, sources {run.manifest['source_hash']} |

## Rank correlation

Rank correlation between more noise and lower quality, with an interval of 95 % ({BOOTSTRAPS} bootstrap samples of groups of clips).

{table(['predictor', 'fit', 'held-out', 'all'], [*ranks, *others])}
The halves: clips that differ only in the frame rate are one group. Groups form a chequerboard over view, variant, noise and resolve, so each half has
about as many of each. The constants were fitted on the half `fit` alone, on a grid with steps of a factor of sqrt(2):

{table(['constants', 'time constant, s', 'narrow Gaussian, degrees', 'wide Gaussian, degrees'], constants)}
*Gaze along motion*: errors are averaged over time along the motion of the surface, as in the metric. *Gaze fixed*: they are averaged at one point of
the screen, as ColorVideoVDP does. The difference between the two rows is what the assumption about the gaze costs.

The fit uses a model in Python (`scripts/judges/perceived.py`), which reads frames of 8 bits. With the metric's own constants, its ratio to the metric
is {ratios.min():.3f} to {ratios.max():.3f}. Rounding explains all of the difference but {np.abs(apart).max():.2%} (allowed: {TOLERANCE:.0%}).

## Within each view

{table(['view', 'clips', 'rank correlation', 'mean rank by noise less rank by quality'], within)}
## Clips that disagree most

Rank by perceived noise less rank by lost quality, both from 1 = best of {len(clips)}. Positive: the metric is harsher than the judge.

{table(['clip', 'JOD', 'perceived noise', 'ranks apart', 'half'], rows)}
{shown}
## Columns of `clips.csv`

| column | meaning |
| --- | --- |
| `clip` | view/variant/noise/resolve/frames per second |
| `path`, `variant`, `noise`, `fps`, `resolve` | the view, the variant, the noise, frames per second, the temporal resolve |
| `seeds` | number of seeds |
| `jod`, `jod_se` | quality by ColorVideoVDP (10 = no visible difference; 1 JOD apart = 75 % prefer the better one), mean over seeds and its standard error |
| `perceived_noise`, `perceived_noise_se` | the metric over all frames, display values, mean over seeds and its standard error |
| `fitted_noise` | the same with the constants that were fitted for a gaze along motion |
| `half` | `fit` or `held-out` |
"""
    )
    return reached, agrees, float(np.abs(apart).max())


def main(arguments):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--self-test", action="store_true")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--work", type=Path)
    parser.add_argument("--out", type=Path)
    parser.add_argument("runs", nargs="*")
    options = parser.parse_args(arguments)
    if options.self_test:
        import self_test

        return self_test.main()
    if not options.runs or options.out is None:
        parser.error("give the folders of runs, and --out for the record")
    runs = [Run(folder) for folder in options.runs]
    filmed = [run for run in runs if (run.folder / "video").is_dir()]
    if not filmed:
        fail("none of the runs has videos: one definition needs `video = true`")
    run = filmed[0]
    for other in runs:
        if other.measured() != run.measured() or other.ppd != run.ppd:
            fail(f"{other.folder} and {run.folder} differ in more than the frame rate: run both definitions again")
    rates = [other.fps for other in runs]
    if len(set(rates)) < len(rates):
        fail("two runs have the same frame rate: give one run for each")
    sequences = run.sequences()
    if not sequences:
        fail(f"{run.folder} has no sequences of frames: run it again with `video = true`")

    work = options.work or run.folder.parent / "judged"
    work.mkdir(parents=True, exist_ok=True)
    tasks, kept = [], {}
    for key, (folder, reference, links) in sequences.items():
        seen = run.seen(key)
        if not seen:
            fail(f"{run.folder} has no perceived noise of {'/'.join(key)}: add the metric to its definition")
        kept[key] = work / f"{folder.name}.npz"
        size, count = run.definition["size"], run.definition["frames"]
        software = [importlib.metadata.version(name) for name in ("cvvdp", "torch")]
        stamp = repr([run.manifest["identity"], software, DISPLAY, UNSEEN, rates, run.ppd, perceived.CONSTANTS, DEVIATIONS_DEG, TIMES_S, seen])
        tasks.append((size, run.ppd, count, rates, seen, folder, reference, links, kept[key], stamp))
    with ProcessPoolExecutor(options.jobs) as pool:
        for done, _ in enumerate(pool.map(look, tasks), 1):
            if done % 20 == 0 or done == len(tasks):
                print(f"judges: {done} of {len(tasks)} sequences", flush=True)

    groups = {}
    for key in sequences:
        groups.setdefault(key[:4], []).append(key)
    clips = []
    for group, keys in sorted(groups.items()):
        stored = [dict(np.load(kept[key])) for key in keys]
        for of_rate in runs:
            values = [{metric: of_rate.over_frames(key, metric) for metric in ["perceived_noise", *OTHERS]} for key in keys]
            if any(value["perceived_noise"] is None for value in values):
                fail(f"{of_rate.folder} has no perceived noise of {'/'.join(group)}: run its definition again")
            clips.append(Clip(group, of_rate.fps, list(zip(values, stored))))
    split(clips)
    reached, agrees, apart = record(options.out, run, runs, clips, shares_of(rates), " ".join(["judge.py", *arguments]))
    print(f"judges: Spearman {reached:.3f} on held-out clips; {options.out / 'README.md'}")
    if not agrees:
        fail(f"the model of perceived noise in Python differs from the metric by up to {apart:.1%}: scripts/judges/perceived.py must follow a change")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
