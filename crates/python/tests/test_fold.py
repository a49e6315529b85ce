"""The folding loop."""

import csv
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from selvedge import Scenario, fold

SCENARIO = str(ROOT / "fixtures/scenarios/corner_fold.toml")


@pytest.mark.parametrize("solver", ["default", "published"])
def test_same_bits_as_the_compiled_loop(corner_fold: Scenario, solver: str, tmp_path: Path) -> None:
    steps = corner_fold.steps if solver == "default" else 150
    ours = fold.fold(corner_fold, "C2", solver, steps).recording
    theirs = corner_fold.run("C2", "published" if solver == "published" else "default")
    ours.write(tmp_path / "ours.npz")
    theirs.write(tmp_path / "theirs.npz")
    with np.load(tmp_path / "ours.npz") as a, np.load(tmp_path / "theirs.npz") as b:
        assert a.files == b.files
        for name in set(a.files) - {"meta", "quads", "grid", "sides"}:
            rows = len(a["t"])
            assert rows == steps + 1
            assert np.array_equal(a[name], b[name][:rows]), name


def test_command_writes_recordings_table_and_page(tmp_path: Path) -> None:
    assert fold.main(["--simulator", "default", "--out", str(tmp_path), SCENARIO, "C4"]) == 0
    names = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.*"))
    assert names == ["default/C4.npz", "default/C8.npz", "report.html", "table.csv"]
    with (tmp_path / "table.csv").open() as file:
        header, row = csv.reader(file)
    assert header == fold.HEADER
    assert row[:2] == ["C4", "4"]
    assert float(row[3]) < 0.1


def test_unknown_case_is_told(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert fold.main(["--out", str(tmp_path / "none"), SCENARIO, "C9"]) == 2
    assert "case: C9, must be one of" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(("name", "steps"), [("xpbd", 160), ("mujoco", 160), ("newton", 80)])
def test_short_fold_elsewhere(corner_fold: Scenario, name: str, steps: int) -> None:
    if name != "xpbd":
        pytest.importorskip(name)
    run = fold.fold(corner_fold, "C8", name, steps)
    here = fold.fold(corner_fold, "C8", "default", steps)
    assert run.support == here.support
    corner = run.recording.positions()[643]
    assert corner == pytest.approx(here.recording.positions()[643], abs=1e-4)  # where the sheet lay when the jaws closed
    assert corner[2] > (0.02 if steps > 120 else 1e-4)  # it starts to move in step 120
