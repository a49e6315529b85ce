"""What is told where an optional package is missing."""

import sys
from importlib import import_module
from pathlib import Path

import pytest

import selvedge
from selvedge import Mesh, Recording, adapters, fold


@pytest.mark.parametrize(
    ("extra", "package"), [("mujoco", "mujoco"), ("newton", "newton"), ("gym", "gymnasium")]
)
def test_missing_package_is_named_with_its_extra(
    extra: str, package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    for module in ("selvedge.gym", f"selvedge.adapters.{extra}"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    with pytest.raises(ImportError, match=rf"{extra}: .*{package}.*pip install 'selvedge\[{extra}\]'"):
        if extra == "gym":
            import_module("selvedge.gym")
        else:
            adapters.make(extra, Mesh.grid((3, 3), (1, 1)), {})


def test_lerobot_needs_pyarrow(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    recording = Recording(Mesh.grid((3, 3), (1, 1)), 0)
    with pytest.raises(ImportError, match=r"pip install 'selvedge\[lerobot\]'"):
        selvedge.to_lerobot(tmp_path / "set", [recording])
    assert not (tmp_path / "set").exists()


def test_command_tells_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    monkeypatch.delitem(sys.modules, "selvedge.adapters.mujoco", raising=False)
    scenario = Path(__file__).parents[3] / "fixtures/scenarios/corner_fold.toml"
    assert fold.main(["--simulator", "mujoco", "--out", str(tmp_path / "out"), str(scenario), "C8"]) == 2
    assert "pip install 'selvedge[mujoco]'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
