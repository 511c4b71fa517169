"""The product against a MuJoCo table: `python tests/benchmarks/plant/agreement.py --out A.png`.

Same volts for 2 s, channel by channel; the moving plate's terms against Eq. 15 alone; free releases
under the product's own pilot. Two minutes; `--seeds 1` takes half a minute.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.support.mujoco_engine.ball_windows import WINDOW_S, residuals, rms_mm
from tests.support.mujoco_engine.closed_loop import (
    cell,
    default_table,
    on_mujoco,
    on_product,
    quiet,
)
from tests.support.mujoco_engine.comparison import (
    TABLES,
    Start,
    by_mujoco,
    by_product,
    gap,
    multisine,
    steps,
    table_with,
)
from tests.support.mujoco_engine.mechanism import Build

LOOSE = table_with(joint_deg=2.0)
LOOSE = replace(LOOSE, drive=replace(LOOSE.drive, joint_friction_nm=0.0))
LIGHT = replace(LOOSE, ball=replace(LOOSE.ball, mass_kg=1e-5))
CASES = TABLES | {"joint play 2 deg, no joint friction": LOOSE, "the same, ball of 10 mg": LIGHT}
SIGNALS = {"multi-sine": multisine(), "steps": steps()}
BUILDS = {
    "": Build(),
    ", inertia at the crank": Build(crank_share=0.98),
    ", universal joint": Build(universal=True),
}
EXTRA = {
    ", inertia at the crank": ("no friction, no play", "the same, ball of 10 mg"),
    ", universal joint": ("no friction, no play",),
}
RELEASES = ((0.0, 0.0), (1.0, 1.5), (2.0, 0.0), (0.0, 3.0))  # gear and joint play [deg]
NOISE_M = 3e-4
SECONDS = 15.0


def trajectories() -> None:
    print("Same volts for 2 s, product minus MuJoCo, RMS / largest (both axes):\n")
    print("| table | volts | motor mrad | encoder mrad | plate mrad | ball mm |")
    print("|---|---|---|---|---|---|")
    for signal, volts in SIGNALS.items():
        for name, rig in CASES.items():
            ours = by_product(rig, volts, Start())
            for extra, build in BUILDS.items():
                if extra and name not in EXTRA.get(extra, ()):
                    continue
                g = gap(ours, by_mujoco(rig, volts, Start(), build=build))
                pairs = (g.motor_rad, g.arm_rad, g.plate_rad, g.ball_m)
                cells = " | ".join(f"{1e3 * rms:.3f} / {1e3 * top:.3f}" for rms, top in pairs)
                print(f"| {name}{extra} | {signal} | {cells} |", flush=True)


def moving_plate() -> None:
    noise = np.random.default_rng(0)
    print(f"\nThe ball alone, windows of {WINDOW_S} s on MuJoCo's plate, RMS residual in mm:\n")
    print("| table | Eq. 15 alone | all terms | Eq. 15, camera noise 0.3 | all terms, noise 0.3 |")
    print("|---|---|---|---|---|")
    for name in ("friction", "both plays", "solid ball"):
        rig = CASES[name]
        run = by_mujoco(rig, SIGNALS["multi-sine"], Start((0.03, -0.03)))
        found = [residuals(run, rig.ball, moving_plate=all_terms) for all_terms in (False, True)]
        seen = [f + NOISE_M * noise.standard_normal(f.shape) for f in found]
        print(f"| {name} | " + " | ".join(f"{rms_mm(f):.4f}" for f in found + seen) + " |")


def closed_loops(seeds: int) -> None:
    print(
        f"\nFree releases of {SECONDS:g} s under the product's pilot, means over {seeds} seeds:\n"
    )
    print(
        "| gear / joint play deg | arm | engine | axes that cycle | amplitude mm | period s "
        "| spread mm | servo mrad | gear found deg | joint found deg |\n" + "|---" * 10 + "|"
    )
    for gear, joint in RELEASES:
        rig = default_table(gear, joint)
        for arm in ("without", "with"):
            for engine, run in (("product", on_product), ("MuJoCo", on_mujoco)):
                c = cell([run(rig, arm, SECONDS, seed) for seed in range(seeds)])
                print(
                    f"| {gear:g} / {joint:g} | {arm} | {engine} | {c.cycling} of {2 * seeds} "
                    f"| {c.amplitude_mm:.2f} | {c.period_s:.2f} | {c.spread_mm:.2f} "
                    f"| {c.servo_mrad:.1f} | {c.gear_deg:.2f} | {c.joint_deg:.2f} |",
                    flush=True,
                )


def noise_free() -> None:
    print("\nA release without sensor noise, arm without, product minus MuJoCo, ball in mm:\n")
    print("| MuJoCo's step ms | RMS | largest in 8 s |\n|---|---|---|")
    rig = quiet(default_table(1.0, 1.5))
    ours = on_product(rig, "without", 8.0, 0).ball()[1]
    for step in (2e-4, 1e-4, 5e-5):
        d = ours - on_mujoco(rig, "without", 8.0, 0, build=Build(step_s=step)).ball()[1]
        print(f"| {1e3 * step:g} | {rms_mm(d):.3f} | {1e3 * np.abs(d).max():.3f} |")


def figure(path: Path) -> None:
    """Overlaid trajectories, their residuals, Eq. 15 against all terms, and a limit cycle."""
    from matplotlib.figure import Figure

    rig, volts = CASES["both plays"], SIGNALS["multi-sine"]
    ours, theirs = by_product(rig, volts, Start()), by_mujoco(rig, volts, Start())
    sheet = Figure(figsize=(11, 11), layout="constrained")
    axes = sheet.subplots(4, 2)
    rows = (
        ("arm_rad", "encoder angle", "mrad", 1.0),
        ("plate_rad", "plate tilt", "mrad", 0.25),
        ("ball_m", "ball, plate frame", "mm", None),
    )
    for (name, label, unit, tolerance), (left, right) in zip(rows, axes[:3], strict=True):
        p, m = 1e3 * getattr(ours, name), 1e3 * getattr(theirs, name)
        for a, colour in enumerate(("tab:blue", "tab:orange")):
            left.plot(ours.t_s, p[:, a], color=colour, lw=3, alpha=0.4, label=f"{'xy'[a]} product")
            left.plot(ours.t_s, m[:, a], color=colour, lw=1, ls="--", label=f"{'xy'[a]} MuJoCo")
            right.plot(ours.t_s, p[:, a] - m[:, a], color=colour, lw=0.8, label="xy"[a])
        for edge in (-tolerance, tolerance) if tolerance else ():
            right.axhline(edge, color="gray", ls=":", lw=1)
        left.set(ylabel=f"{label} [{unit}]", xlabel="time [s]")
        right.set(ylabel=f"difference [{unit}]", xlabel="time [s]")
    axes[0, 0].legend(ncols=4, fontsize=7, loc="upper center")
    axes[0, 0].set_ylim(-400, 480)
    axes[0, 1].legend(fontsize=8)
    axes[0, 0].set_title("Same volts: gear play 1 deg, joint play 1.5 deg, dry friction")
    axes[0, 1].set_title("Product - MuJoCo (dotted: tolerance of the tests)")
    _windows(axes[3, 0], theirs, rig)
    _limit_cycle(axes[3, 1])
    sheet.savefig(path, dpi=110)


def _windows(axis, run, rig) -> None:
    for moving, label, colour in ((False, "Eq. 15 alone", "tab:red"), (True, "all", "tab:green")):
        found = 1e3 * residuals(run, rig.ball, moving_plate=moving)
        t = run.t_s[: found.shape[1]]
        for i, window in enumerate(found):
            name = f"{label}: {np.sqrt(np.mean(found**2)):.2g} mm RMS" if i == 0 else None
            axis.plot(t + i * WINDOW_S, window[:, 0], color=colour, lw=1.2, label=name)
    axis.set(xlabel="time [s]", ylabel="ball x: predicted - MuJoCo [mm]")
    axis.set_title(f"The moving plate's terms, windows of {WINDOW_S} s")
    axis.set_ylim(-1.2, 2.0)
    axis.legend(fontsize=8, loc="upper center")


def _limit_cycle(axis) -> None:
    rig = quiet(default_table(1.0, 1.5))
    for run, style, width in ((on_product, "-", 3.0), (on_mujoco, "--", 1.0)):
        t, xy = run(rig, "without", SECONDS, 0).ball()
        for a, colour in enumerate(("tab:blue", "tab:orange")):
            axis.plot(
                t, 1e3 * xy[:, a], style, color=colour, lw=width, alpha=0.4 if width > 1 else 1.0
            )
    axis.set(xlabel="time [s]", ylabel="ball, plate frame [mm]", ylim=(-40, 40))
    axis.set_title("Closed loop: free release, no sensor noise, arm without")


def main() -> None:
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--out", type=Path, help="write the figure here (PNG)")
    options.add_argument("--seeds", type=int, default=4, help="free releases a cell")
    chosen = options.parse_args()
    trajectories()
    moving_plate()
    noise_free()
    closed_loops(chosen.seeds)
    if chosen.out:
        figure(chosen.out)


if __name__ == "__main__":
    main()
