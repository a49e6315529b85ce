"""Plans a fold by cross-entropy search: two grippers at the far corners, the same way for both.

Searched are the middle control point of the way (y, z), its end (y, z), and how far the grippers turn
about x. The cost is the error against the ideal half fold after the sheet has settled. De Boer et al.
2005: sample a Gaussian, fit it to the best, repeat.
"""

import time

import numpy as np
from numpy.typing import NDArray

from selvedge import BoxVolume, Gripper, Grippers, Mesh, Schedule, Squeeze, Sweep, Worlds, fold_error, half_fold

MESH = Mesh.grid((12, 14), (0.42, 0.59))
IDEAL = half_fold(MESH, 1e-3)
CORNERS = MESH.rest[[-1, -12]]
DT, CLOSE, START, OPEN, END = 1 / 60, 0.1, 0.2, 2.2, 3.2  # [s]
POPULATION, BEST, ROUNDS = 24, 6, 3


def schedule(corner: NDArray[np.float64], plan: NDArray[np.float64]) -> Schedule:
    """The way of one gripper."""
    mid_y, mid_z, end_y, end_z, turn = plan
    x = corner[0]
    end = (0.0, 0.0, 0.0, 1.0), (np.sin(turn / 2), 0.0, 0.0, np.cos(turn / 2))
    sweep = Sweep(corner, (x, mid_y, mid_z), (x, end_y, max(end_z, 0.001)), *end)
    return Schedule.fold(sweep, CLOSE, START, OPEN, END)


def errors(worlds: Worlds, plans: NDArray[np.float64]) -> NDArray[np.float64]:
    """The folding error of each plan."""
    schedules = [[schedule(corner, plan) for corner in CORNERS] for plan in plans]
    for world in range(len(plans)):
        worlds.reset(world)
    for step in range(round(END / DT)):
        commands = [[one.command(step * DT) for one in both] for both in schedules]
        # A sheet that cannot follow stays where it was, and its error is large.
        poses = [[[*pose.position, *pose.quaternion_xyzw] for pose, _ in both] for both in commands]
        worlds.step(poses, [[closed for _, closed in both] for both in commands], DT)
    return np.array([fold_error(end, IDEAL, MESH.diagonal) for end in worlds.positions])


def main() -> None:
    """Prints the error before, that of each round and the gain."""
    # Without a squeeze along x, which would pull at the taut row between the two.
    grippers = Grippers([Gripper(BoxVolume((0.05, 0.05, 0.05)), Squeeze(0.0)) for _ in CORNERS])
    worlds = Worlds(POPULATION, MESH, grippers, {"thickness": 1e-3}, threads=2)
    generator, start = np.random.default_rng(0), time.perf_counter()
    mean = np.array([0.0, 0.3, -0.295, 0.02, 0.0])  # the obvious arc
    spread = np.array([0.1, 0.1, 0.03, 0.01, 0.8])
    first = errors(worlds, np.tile(mean, (POPULATION, 1)))[0]
    best, least = mean, first
    print(f"the obvious arc: E = {100 * first:.3f} %")
    for number in range(1, ROUNDS + 1):
        plans = generator.normal(mean, spread, (POPULATION, len(mean)))
        cost = errors(worlds, plans)
        order = np.argsort(cost)
        mean, spread = plans[order[:BEST]].mean(axis=0), plans[order[:BEST]].std(axis=0)
        if cost[order[0]] < least:
            best, least = plans[order[0]], cost[order[0]]
        middle = np.median(cost[order[:BEST]])
        print(f"round {number:2}: E = {100 * least:.3f} %, of the best {BEST} {100 * middle:.3f} %", flush=True)
    print(f"mid ({best[0]:.3f}, {best[1]:.3f}) m, end ({best[2]:.3f}, {best[3]:.3f}) m, turned {best[4]:.2f} rad")
    print(f"gain: {first / least:.1f} times, {time.perf_counter() - start:.0f} s")
    assert least < 0.7 * first


if __name__ == "__main__":
    main()
