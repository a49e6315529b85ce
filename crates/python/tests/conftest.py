"""What the tests share."""

from pathlib import Path

import pytest

from selvedge import Scenario

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="session")
def corner_fold() -> Scenario:
    return Scenario.load(ROOT / "fixtures/scenarios/corner_fold.toml")
