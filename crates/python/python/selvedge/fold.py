"""Runs a scenario file on any simulator: `python -m selvedge.fold --simulator mujoco SCENARIO.toml C1`.

The loop is the same for all: commands, grippers, simulator, recording. Errors are measured against
the end of the reference case on the same simulator. Written are recordings, a table and a page.
"""

import argparse
import csv
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from . import Recording, Scenario, __version__, adapters, fold_error, half_fold, write_page

SIMULATORS = ("default", "published", *adapters.NAMES)
RELEASED = 0.5  # [s] after which an edge that the squeeze has shortened counts again


@dataclass
class Fold:
    """A case that was run."""

    case: str
    recording: Recording
    support: list[int] = field(default_factory=list)
    strain: float = 0.0
    seconds: float = 0.0
    speed: float = 0.0


def simulator(scenario: Scenario, name: str) -> adapters.Simulator:
    """The scenario's cloth at rest on a simulator."""
    if name == "default":
        return scenario.cloth("default")
    if name == "published":
        return scenario.cloth("published")
    return adapters.make(name, scenario.mesh, scenario.material, scenario.gravity)


def fold(
    scenario: Scenario,
    case: str,
    name: str,
    steps: int | None = None,
    observe: Callable[[int], None] | None = None,
) -> Fold:
    """Runs a case, or its first `steps` steps; raises `ValueError` when jaws close on nothing."""
    mesh, dt = scenario.mesh, scenario.dt
    faces = mesh.quads if len(mesh.quads) else mesh.triangles
    edges = mesh.edges
    cloth, grippers = simulator(scenario, name), scenario.grippers(case)
    times, poses, closed = scenario.commands(case)
    meta = {
        "scenario": scenario.name, "case": case, "solver": name, "version": __version__, "dt": dt,
        "material": scenario.material, "grippers": scenario.volumes(case),
    }  # fmt: skip
    count = closed.shape[1]
    recording = Recording(mesh, count, json.dumps(meta))
    positions = cloth.positions
    recording.push(0.0, positions, poses[0], [False] * count, [0.0] * count, grippers.holders(len(positions)))
    result = Fold(case, recording)
    lengths = np.linalg.norm(mesh.rest[edges[:, 0]] - mesh.rest[edges[:, 1]], axis=1)
    held_until = np.full(len(edges), -np.inf)
    was = np.zeros(count, bool)
    total = len(times) if steps is None else steps
    for step in range(total):
        closing = bool((closed[step] & ~was).any())
        anchors = scenario.anchors("published", positions) if name == "published" and closing else None
        held = grippers.step(poses[step], closed[step], positions, faces, edges, dt, anchors)
        start = time.perf_counter()
        cloth.step(held, dt)
        result.seconds += time.perf_counter() - start
        positions = cloth.positions
        now = scenario.time(step + 1)
        holders = grippers.holders(len(positions))
        for gripper in np.flatnonzero(closed[step] & ~was):
            size = int((holders == gripper + 1).sum())
            if size == 0:
                raise ValueError(f"{case}: gripper {gripper + 1} closes on nothing at {times[step]:.3f} s")
            result.support.append(size)
        was = closed[step]
        recording.push(now, positions, poses[step], closed[step], grippers.alphas, holders)
        held_until[(holders[edges] > 0).all(axis=1)] = now
        stretched = np.linalg.norm(positions[edges[:, 0]] - positions[edges[:, 1]], axis=1) / lengths - 1
        counted = now - held_until > RELEASED
        result.strain = max(result.strain, float(np.abs(stretched[counted]).max()))
        if observe:
            observe(step)
    result.speed = total * dt / result.seconds
    return result


def ideal(scenario: Scenario, case: str, done: dict[str, Fold]) -> NDArray[np.float64]:
    """What the end of a case should be."""
    reference = scenario.reference(case)
    if reference is None:
        return half_fold(scenario.mesh, scenario.material["thickness"])
    return done[reference].recording.positions()


def rows(scenario: Scenario, done: dict[str, Fold], wanted: Sequence[str]) -> list[list[str]]:
    """Case, support, folding error [%], largest strain [%], times as fast as reality."""
    table = []
    for case in wanted:
        run = done[case]
        error = fold_error(run.recording.positions(), ideal(scenario, case, done), scenario.mesh.diagonal)
        support = "+".join(map(str, run.support))
        table.append([case, support, f"{100 * error:.3f}", f"{100 * run.strain:.3f}", f"{run.speed:.2f}"])
    return table


HEADER = ["case", "support", "E [%]", "strain [%]", "speed"]


def curve(run: Fold, wanted: NDArray[np.float64], diagonal: float) -> list[tuple[float, float]]:
    """The folding error over time."""
    recording = run.recording
    return [
        (float(t), fold_error(recording.positions(k), wanted, diagonal))
        for k, t in enumerate(recording.times)
    ]


def write(folder: Path, scenario: Scenario, name: str, done: dict[str, Fold], wanted: list[str]) -> None:
    """Recordings, `table.csv` and `report.html`."""
    (folder / name).mkdir(parents=True, exist_ok=True)
    for case, run in done.items():
        run.recording.write(folder / name / f"{case}.npz")
    table = rows(scenario, done, wanted)
    with (folder / "table.csv").open("w", newline="") as file:
        csv.writer(file).writerows([HEADER, *table])
    clips = []
    for case in wanted:
        aim = ideal(scenario, case, done)
        clips.append((case, name, done[case].recording, aim, curve(done[case], aim, scenario.mesh.diagonal)))
    columns = [(header, k > 0, [row[k] for row in table]) for k, header in enumerate(HEADER)]
    write_page(
        folder / "report.html", f"{scenario.name} on {name}", clips, table=("Folds", columns),
        command="python -m selvedge.fold " + " ".join(sys.argv[1:]),
    )  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; 0 when all is well, 2 for bad input or a fold that failed."""
    parser = argparse.ArgumentParser(prog="python -m selvedge.fold", description=__doc__)
    parser.add_argument("--simulator", choices=SIMULATORS, default="default")
    parser.add_argument("--out", type=Path, default=Path("folds"))
    parser.add_argument("scenario", type=Path)
    parser.add_argument("cases", nargs="*", metavar="CASE")
    options = parser.parse_args(arguments)
    try:
        scenario = Scenario.load(options.scenario)
        wanted = options.cases or scenario.cases
        needed = list(dict.fromkeys([*wanted, *filter(None, map(scenario.reference, wanted))]))
        done = {}
        for case in needed:
            print(f"{case} on {options.simulator}", file=sys.stderr)
            done[case] = fold(scenario, case, options.simulator)
    except (ValueError, ImportError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    for row in [HEADER, *rows(scenario, done, wanted)]:
        print("".join(f"{cell:>11}" for cell in row))
    write(options.out, scenario, options.simulator, done, wanted)
    print(f"written: {options.out}/report.html")
    return 0


if __name__ == "__main__":
    sys.exit(main())
