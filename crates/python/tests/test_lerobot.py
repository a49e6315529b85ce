"""The data set for LeRobot."""

import json
from pathlib import Path

import numpy as np
import pytest

from selvedge import Scenario, fold
from selvedge.lerobot import to_lerobot

parquet = pytest.importorskip("pyarrow.parquet")


def test_data_set_holds_the_recordings(corner_fold: Scenario, tmp_path: Path) -> None:
    runs = [fold.fold(corner_fold, case, "default", steps=70).recording for case in ("C4", "C8")]
    to_lerobot(tmp_path / "folds", runs, task="fold the sheet")
    info = json.loads((tmp_path / "folds/meta/info.json").read_text())
    assert (info["total_episodes"], info["total_frames"], info["fps"]) == (2, 140, 60)
    table = parquet.read_table(tmp_path / "folds/data/chunk-000/file-000.parquet")
    assert table.num_rows == 140
    assert set(info["features"]) == set(table.column_names)
    state = np.array(table["observation.state"].to_pylist())
    size = info["features"]["observation.state"]["shape"][0]
    assert state.shape == (140, size) and size == 3 * 644
    assert state[75] == pytest.approx(runs[1].positions(5).ravel(), abs=1e-7)
    assert table["episode_index"].to_pylist() == [0] * 70 + [1] * 70
    assert table["frame_index"].to_pylist() == [*range(70)] * 2
    action = np.array(table["action"].to_pylist())
    assert action.shape == (140, 8)
    assert action[[0, 69], 7].tolist() == [0, 1]
    episodes = parquet.read_table(tmp_path / "folds/meta/episodes/chunk-000/file-000.parquet")
    assert episodes["length"].to_pylist() == [70, 70]


def test_folder_in_use_is_refused(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    with pytest.raises(ValueError, match="folder: .* exists"):
        to_lerobot(tmp_path / "there", [])
