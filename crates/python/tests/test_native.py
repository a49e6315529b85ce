"""What the compiled part says of its arguments, and small checks by hand."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from numpy.typing import NDArray

import selvedge
from selvedge import BoxVolume, Gripper, Mesh, Pose, Scenario, Squeeze

MESH = Mesh.grid((3, 3), (0.2, 0.2))


def test_float32_and_float64_give_the_same_grasp() -> None:
    found = []
    for kind in (np.float32, np.float64):
        gripper = Gripper(BoxVolume((0.04, 0.04, 0.04)), Squeeze(0.0, 0.0, 1))
        positions: NDArray[Any] = MESH.rest.astype(kind)
        found.append(gripper.step(Pose((0.1, 0.1, 0)), True, positions))
    assert found[0][0].tolist() == found[1][0].tolist() == [8]
    assert found[0][1] == pytest.approx(found[1][1], abs=1e-7)


@pytest.mark.parametrize(
    ("positions", "error", "text"),
    [
        (np.zeros((4, 2)), ValueError, r"positions: shape is \[4, 2\], must be \(N, 3\)"),
        (np.zeros((4, 3), int), TypeError, "positions: must be a float64 or float32 array"),
        (np.full((4, 3), np.nan), ValueError, "positions: row 0 is .*, must be finite"),
        (np.asfortranarray(MESH.rest), ValueError, "positions: must be in C order"),
    ],
)
def test_bad_positions_are_named(positions: NDArray[Any], error: type[Exception], text: str) -> None:
    gripper = Gripper(BoxVolume((0.04, 0.04, 0.04)))
    with pytest.raises(error, match=text):
        gripper.step(Pose(), True, positions)


def test_faces_in_columns_are_refused() -> None:
    with pytest.raises(ValueError, match="faces: must be in C order"):
        Mesh(MESH.rest, np.asfortranarray(MESH.quads))


def test_bad_numbers_are_named() -> None:
    with pytest.raises(ValueError, match="quaternion"):
        Pose((0, 0, 0), (0, 0, 0, 0))
    with pytest.raises(ValueError, match="material: weight is not one of"):
        selvedge.Cloth(MESH, {"weight": 1.0})
    with pytest.raises(ValueError, match="threads: 0, must be at least 1"):
        selvedge.Cloth(MESH, threads=0)
    with pytest.raises(ValueError, match="orientation: straight, must be slerp or nlerp"):
        selvedge.Sweep((0, 0, 0), (0, 0, 1), (1, 0, 0), (0, 0, 0, 1), (0, 0, 0, 1), "straight")  # type: ignore[arg-type]


def test_log_comes_back(corner_fold: Scenario, tmp_path: Path) -> None:
    t, poses, closed = corner_fold.commands("C8")
    path = tmp_path / "C8.commands.csv"
    selvedge.write_log(path, t, poses[:, 0], closed[:, 0], corner_fold.tip_offsets("C8")[0])
    log = selvedge.read_log(path)
    assert np.array_equal(log["t"], t) and np.array_equal(log["closed"], closed[:, 0])
    assert log["pose"] == pytest.approx(poses[:, 0], abs=1e-12)


def test_reach_tells_base_and_joints(tmp_path: Path) -> None:
    scenario = Scenario.load(ROOT / "fixtures/scenarios/franka_fold.toml")
    case = scenario.cases[0]
    t, poses, closed = scenario.commands(case)
    path = tmp_path / "log.csv"
    selvedge.write_log(path, t, poses[:, 0], closed[:, 0], scenario.tip_offsets(case)[0])
    found = selvedge.reach(path, "fr3")
    assert found["feasible"] and found["joints"].shape == (len(t), 7)
    again = selvedge.reach(path, "fr3", found["base"])
    assert again["feasible"]
    far = selvedge.reach(path, "fr3", (5, 0, 0, 0))
    assert not far["feasible"] and far["blocked"] and far["joints"] is None
    with pytest.raises(ValueError, match="robot: ur5, must be fr3 or fer"):
        selvedge.reach(path, "ur5")  # type: ignore[arg-type]
