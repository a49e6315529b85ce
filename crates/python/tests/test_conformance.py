"""One suite for all simulators: what a gripper may rely on."""

import os

import numpy as np
import pytest
from numpy.typing import NDArray

from selvedge import BoxVolume, Gripper, Grippers, Mesh, Pose, Squeeze, adapters

DT = 1 / 60
MATERIAL = {
    "density": 0.3, "gravitational_density": 0.14, "damping": 0.4, "bending": 2.5e-5, "shear": 4.0,
    "friction_table": 0.2, "friction_cloth": 0.6, "thickness": 1e-3, "internal_damping": 1e-2,
}  # fmt: skip
MESH = Mesh.grid((6, 7), (0.25, 0.3))
CORNER = 41  # at +x +y
NONE = (np.zeros(0, np.uint32), np.zeros((0, 3)), np.zeros((0, 3)))
TOLERANCE = {"default": 1e-12, "xpbd": 1e-12, "mujoco": 1e-12, "newton": 1e-6}  # newton has f32


@pytest.fixture(params=["default", *adapters.NAMES])
def name(request: pytest.FixtureRequest) -> str:
    packages = {"mujoco": ["mujoco"], "newton": ["newton", "warp"]}
    for package in packages.get(request.param, []):
        if os.environ.get("CI") == "true":  # where a skip is a failure
            __import__(package)
        pytest.importorskip(package)
    return str(request.param)


@pytest.fixture
def cloth(name: str) -> adapters.Simulator:
    return adapters.make(name, MESH, MATERIAL)


def gripper(amount: float = 0.0, steps: int = 1) -> Gripper:
    return Gripper(BoxVolume((0.07, 0.07, 0.07)), Squeeze(amount, 0.0, steps))


def step(cloth: adapters.Simulator, gripper: Gripper, pose: Pose, closed: bool) -> adapters.Held:
    held = gripper.step(pose, closed, cloth.positions, MESH.quads, MESH.edges, DT)
    cloth.step(held, DT)
    return held


def at(cloth: adapters.Simulator, offset: tuple[float, float, float] = (0, 0, 0)) -> Pose:
    return Pose(cloth.positions[CORNER] + np.array(offset))


def gap(found: NDArray[np.float64], wanted: NDArray[np.float64]) -> float:
    return float(np.abs(found - wanted).max())


def test_empty_capture_holds_nothing(name: str, cloth: adapters.Simulator) -> None:
    jaws = gripper()
    nodes, _, _ = step(cloth, jaws, at(cloth, (0, 0, 0.5)), True)
    assert len(nodes) == 0 and jaws.event == "empty"
    # Nothing of it is carried when the closed gripper comes by later.
    step(cloth, jaws, at(cloth, (0, 0, 0.03)), True)
    assert gap(cloth.positions, MESH.rest) < 1e-3


def test_capture_while_moving(name: str, cloth: adapters.Simulator) -> None:
    jaws, start = gripper(), at(cloth)
    for k in range(6):
        pose = Pose(np.array(start.position) + (0, 0, 0.004 * k))
        nodes, targets, velocities = step(cloth, jaws, pose, k >= 2)
        assert (len(nodes) > 0) == (k >= 2)
        if k >= 2:
            assert gap(cloth.positions[nodes], targets) < TOLERANCE[name]
    assert gap(velocities, np.tile([0, 0, 0.004 / DT], (len(nodes), 1))) < 1e-9
    assert cloth.positions[CORNER, 2] == pytest.approx(0.012, abs=2e-4)


def test_rotation_is_carried_exactly(name: str, cloth: adapters.Simulator) -> None:
    jaws, start = gripper(), at(cloth, (0, 0, 0))
    step(cloth, jaws, start, True)
    before = start.inverse().transform(cloth.positions[jaws.nodes])
    assert len(before) >= 1
    for k in range(1, 16):
        angle = 0.04 * k
        pose = Pose(np.array(start.position) + (0, 0, 0.004 * k), (0, 0, np.sin(angle / 2), np.cos(angle / 2)))
        step(cloth, jaws, pose, True)
        after = pose.inverse().transform(cloth.positions[jaws.nodes])
        assert gap(after, before) < TOLERANCE[name]


def test_squeeze_ramp(name: str, cloth: adapters.Simulator) -> None:
    jaws, pose = gripper(amount=0.5, steps=5), at(cloth, (-0.02, 0, 0))
    for k in range(1, 8):
        step(cloth, jaws, pose, True)
        alpha = min(1, k / 5)
        local = pose.inverse().transform(cloth.positions[[CORNER]])[0]
        assert jaws.alpha == pytest.approx(alpha)
        assert local[0] == pytest.approx(0.02 * (1 - 0.5 * alpha), abs=1e-6)


def test_release_leaves_the_implied_velocity(name: str, cloth: adapters.Simulator) -> None:
    jaws, start = gripper(), at(cloth)
    for k in range(25):
        pose = Pose(np.array(start.position) + (0, 0, 0.002 * k))
        nodes, _, velocities = step(cloth, jaws, pose, True)
    assert gap(cloth.velocities[nodes], velocities) < 1e-6
    before = cloth.positions[CORNER]
    free, _, _ = step(cloth, jaws, pose, False)
    assert len(free) == 0
    # It goes on, slowed by its neighbours and weight, and no longer follows.
    moved = (cloth.positions[CORNER] - before)[2]
    assert -0.002 < moved < 0.004
    for _ in range(60):
        step(cloth, jaws, pose, False)
    assert cloth.positions[CORNER, 2] < 0.6 * before[2]


def test_reset_clears(name: str, cloth: adapters.Simulator) -> None:
    jaws, start = gripper(), at(cloth)
    for k in range(10):
        step(cloth, jaws, Pose(np.array(start.position) + (0, 0, 0.003 * k)), True)
    jaws.reset()
    cloth.reset(MESH.rest)
    assert len(jaws.nodes) == 0 and not jaws.closed
    assert gap(cloth.positions, MESH.rest) < 1e-6 and gap(cloth.velocities, 0 * MESH.rest) < 1e-9
    for _ in range(20):
        cloth.step(NONE, DT)
    assert gap(cloth.positions, MESH.rest) < 1e-3


def test_two_grippers(name: str, cloth: adapters.Simulator) -> None:
    both = Grippers([gripper(), gripper()])
    corners = [CORNER - 5, CORNER]
    rest = MESH.rest[corners]
    for k in range(10):
        poses = np.zeros((2, 7))
        poses[:, 6] = 1
        poses[:, :3] = rest + (0, 0, 0.003 * k)
        nodes, targets, _ = both.step(poses, [True, True], cloth.positions, MESH.quads, MESH.edges, DT)
        cloth.step((nodes, targets, _), DT)
        assert gap(cloth.positions[nodes], targets) < TOLERANCE[name]
    holders = both.holders(MESH.node_count)
    assert holders[corners].tolist() == [1, 2]
    assert cloth.positions[corners, 2] == pytest.approx([0.027, 0.027], abs=1e-5)


def test_node_order_permuted(name: str) -> None:
    order = np.random.default_rng(3).permutation(MESH.node_count)
    place = np.argsort(order).astype(np.uint32)
    faces = np.ascontiguousarray(place[MESH.quads])
    shuffled = Mesh(np.ascontiguousarray(MESH.rest[order]), faces)
    ends = []
    for mesh, corner in [(MESH, CORNER), (shuffled, int(place[CORNER]))]:
        cloth, jaws = adapters.make(name, mesh, MATERIAL), gripper()
        for k in range(6):
            pose = Pose(mesh.rest[corner] + (0, 0, 0.003 * k))
            held = jaws.step(pose, True, cloth.positions, mesh.quads, mesh.edges, DT)
            cloth.step(held, DT)
        ends.append(cloth.positions)
        assert len(jaws.nodes) == len(held[0]) > 0
    # The order of passes differs in some, so not the same bits.
    assert gap(ends[0][order], ends[1]) < 2e-3
    assert ends[0][CORNER, 2] == pytest.approx(ends[1][place[CORNER], 2], abs=1e-6)
