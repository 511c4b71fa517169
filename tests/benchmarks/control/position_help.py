"""Does the backlash model help where the servos take an angle? The shipped tables, one picture.

`python tests/benchmarks/control/position_help.py` (20 min). `rig compare` with the shipped grid on
each table; comparisons that stand in `--out`/TABLE are read. Shown is how much less than without a
compensator the ball strays (RMS after settling), seeds paired, 95 % by sign flips, and the verdict.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from experiments.compare.compare import run_comparison
from experiments.picture_files import our_style, subplots
from experiments.progress import silent

ROOT = Path(__file__).parents[3]
TABLES = ("bus-servos", "hobby-two-servos", "three-arms")
PROTOCOLS = {"hold": "o", "free-release": "s", "circle": "^"}
COLOURS = {"with": "#d62728", "sham": "0.5"}
FRICTION = "as measured"


def compared(table: str, out: Path, seeds: int) -> dict:
    """The comparison of a shipped table, made in out/table where it does not stand there."""
    file = out / table / "results.json"
    if not file.is_file():
        (out / table).mkdir(parents=True, exist_ok=True)
        rig = ROOT / "experiments" / "rigs" / f"{table}.toml"
        run_comparison(rig, out / table, seeds=seeds, progress=silent)
    return json.loads(file.read_text(encoding="utf-8"))


def chosen(results: dict) -> list[dict]:
    """Cells without a fault and with the table's own friction, in the grid's order."""
    return [c for c in results["cells"] if not c["fault"] and c["friction"] == FRICTION]


def rows(results: dict) -> dict[str, dict[str, dict]]:
    """Play -> protocol -> the test of the model against no compensator."""
    found: dict[str, dict[str, dict]] = {}
    for cell in chosen(results):
        found.setdefault(cell["play"], {})[cell["protocol"]] = cell["arms"]["with"]
    return found


@our_style()
def picture(found: dict[str, dict], path: Path) -> None:
    """Gains [cm] with intervals: a panel a table, a line a play, model and sham."""
    figure, panels = subplots(1, len(found), figsize=(11, 3.6), sharey=True, sharex=True)
    for panel, (table, results) in zip(panels, found.items(), strict=True):
        plays = list(rows(results))
        for cell in chosen(results):
            line = len(plays) - plays.index(cell["play"])
            shift = 0.25 - 0.25 * list(PROTOCOLS).index(cell["protocol"])
            for arm, colour in COLOURS.items():
                test = cell["arms"][arm]["against_without"]
                if np.isfinite(test["effect"] or np.nan):
                    at = line + shift - (0.08 if arm == "sham" else 0)
                    panel.plot([test["low"], test["high"]], [at, at], color=colour, lw=1.5)
                    marker = PROTOCOLS[cell["protocol"]]
                    panel.plot(test["effect"], at, marker, color=colour, ms=4)
        relevant = chosen(results)[0]["arms"]["with"]["against_without"]["relevant"]
        panel.axvspan(-relevant, relevant, color="0.9", zorder=0)
        panel.set(title=table, xlabel="gain over no compensator [cm RMS]")
        panel.set_yticks(range(len(plays), 0, -1), plays)
    for protocol, marker in PROTOCOLS.items():
        panels[0].plot([], [], marker, color="0.2", ms=4, label=protocol)
    for arm, colour in COLOURS.items():
        panels[0].plot([], [], color=colour, label=arm)
    figure.legend(loc="outside lower center", ncols=len(PROTOCOLS) + len(COLOURS))
    figure.savefig(path)


def word(arm: dict) -> str:
    """A gain with its interval and its verdict, as a cell of the table."""
    test = arm["against_without"]
    if test["effect"] is None or not np.isfinite(test["effect"]):
        return f"lost (n = {test['n']})"
    mark = {"helps": "**helps**", "harms": "**harms**"}.get(test["verdict"], test["verdict"])
    return f"{test['effect']:+.3f} ({test['low']:+.3f} to {test['high']:+.3f}), {mark}"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks/position"))
    parser.add_argument("--picture", type=Path, default=Path("out/benchmarks/position_help.png"))
    options = parser.parse_args()
    found = {table: compared(table, options.out, options.seeds) for table in TABLES}
    picture(found, options.picture)
    print(f"| table, play | {' | '.join(PROTOCOLS)} |")
    print("|---|" + "---|" * len(PROTOCOLS))
    for table, results in found.items():
        for play, by_protocol in rows(results).items():
            cells = [word(by_protocol[p]) if p in by_protocol else "" for p in PROTOCOLS]
            print(f"| {table}, {play} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
