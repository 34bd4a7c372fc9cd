#!/usr/bin/env python3
"""Executes a notebook's code cells in order, in the notebook's folder, and fails if one of them fails.

Needs only Python, and neither a Jupyter kernel nor a server. Figures are drawn without a display. With --write the outputs (text,
pictures) are written into the notebook, so that it can be read without being run.
"""

import argparse
import base64
import contextlib
import io
import json
import os
import sys
import traceback
from pathlib import Path


def run(source: str, names: dict, label: str):
    """Runs one cell and returns the value of its last statement if that is an expression. A notebook shows this value."""
    import ast

    tree = ast.parse(source, label)
    value = None
    last = tree.body[-1] if tree.body else None
    if isinstance(last, ast.Expr):
        tree.body.pop()
        exec(compile(tree, label, "exec"), names)
        value = eval(compile(ast.Expression(last.value), label, "eval"), names)
    else:
        exec(compile(tree, label, "exec"), names)
    return value


def figures():
    """Returns the open figures of a cell as PNG files, and closes them."""
    plt = sys.modules.get("matplotlib.pyplot")
    pictures = []
    if plt is not None:
        for number in plt.get_fignums():
            buffer = io.BytesIO()
            plt.figure(number).savefig(buffer, format="png", dpi=80, bbox_inches="tight")
            pictures.append(buffer.getvalue())
        plt.close("all")
    return pictures


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("notebook", type=Path)
    parser.add_argument("--write", action="store_true", help="put the outputs into the notebook")
    args = parser.parse_args()
    os.environ["MPLBACKEND"] = "Agg"
    notebook = json.loads(args.notebook.read_text(encoding="utf-8"))
    home = os.getcwd()
    os.chdir(args.notebook.resolve().parent)
    names = {"__name__": "__main__"}
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    drawn = 0
    for index, cell in enumerate(cells, 1):
        text = io.StringIO()
        try:
            with contextlib.redirect_stdout(text):
                value = run("".join(cell["source"]), names, f"{args.notebook.name}, code cell {index}")
        except Exception:
            traceback.print_exc()
            print(f"error: {args.notebook}: code cell {index} of {len(cells)} failed", file=sys.stderr)
            return 1
        pictures = figures()
        drawn += len(pictures)
        outputs = []
        printed = text.getvalue() + (f"{value}\n" if value is not None else "")
        if printed:
            outputs.append({"output_type": "stream", "name": "stdout", "text": printed.splitlines(True)})
        for picture in pictures:
            data = {"image/png": base64.b64encode(picture).decode("ascii")}
            outputs.append({"output_type": "display_data", "data": data, "metadata": {}})
        cell["outputs"] = outputs
        cell["execution_count"] = index
    os.chdir(home)
    if not cells or drawn == 0:
        print(f"error: {args.notebook}: {len(cells)} code cells drew {drawn} figures, so nothing was checked: add cells that draw", file=sys.stderr)
        return 1
    if args.write:
        args.notebook.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    print(f"{args.notebook}: {len(cells)} code cells ran, {drawn} figures were drawn")
    return 0


if __name__ == "__main__":
    sys.exit(main())
