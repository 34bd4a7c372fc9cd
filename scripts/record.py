#!/usr/bin/env python3
"""Writes a small record of a run for notebooks-data: most rows, the files that describe the run, and the headline numbers as headline.csv.

The record has no rows of the metric `power`, and no rows of single frames for the metrics in PER_FRAME.

Usage: record.py RUN_FOLDER notebooks-data/NAME   (in the environment that scripts/notebook.sh makes)
"""

import csv
import json
import shutil
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

# Version of the tables' columns that this script reads.
SCHEMA = "2"
# Metrics whose rows of single frames are omitted. Their rows over all frames are kept.
PER_FRAME = [
    "fetches_per_px", "flip_rate", "difference", "excess_difference", "residual", "residual_rms", "added", "lost", "perceived_noise",
    "taa_rejections", "disoccluded", "reference_difference",
]
# The columns of headline.csv after view and noise. `added` has rows for albedo and for the lit picture; the value of the lit picture is used.
HEADLINE = ["flip_rate", "clumping", "added"]


def main() -> int:
    run, record = Path(sys.argv[1]), Path(sys.argv[2])
    schema = json.loads((run / "manifest.json").read_text(encoding="utf-8"))["schema"]
    if schema != SCHEMA:
        print(f"error: {run}/manifest.json: its schema is {schema}, but this script reads schema {SCHEMA}: repeat the run", file=sys.stderr)
        return 1
    record.mkdir(parents=True, exist_ok=True)
    table = pq.read_table(run / "metrics.parquet")
    of_frames = pc.is_in(table["metric"], value_set=pa.array(PER_FRAME))
    kept = table.filter(pc.or_(pc.is_null(table["frame"]), pc.invert(of_frames)))
    kept = kept.filter(pc.not_equal(kept["metric"], "power"))
    pq.write_table(kept, record / "metrics.parquet", compression="zstd")
    for name in ["manifest.json", "report.md", "times.csv"]:
        shutil.copy(run / name, record / name)
    rows = kept.to_pylist()
    found = {}
    for row in rows:
        shown = row["signal"] == "lit" or row["metric"] != "added"
        if row["variant"] == "near-cliff" and row["metric"] in HEADLINE and row["lag"] in (None, 1) and shown:
            found.setdefault((row["view"], row["noise"]), {})[row["metric"]] = row["value"]
    with open(record / "headline.csv", "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["view", "noise", *HEADLINE])
        for (view, noise), values in sorted(found.items()):
            writer.writerow([view, noise, *(values[metric] for metric in HEADLINE)])
    print(f"{record}: {len(rows)} of {table.num_rows} rows")
    return 0


if __name__ == "__main__":
    sys.exit(main())
