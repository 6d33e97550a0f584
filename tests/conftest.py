"""Where tests find the data and programs that are not part of the project."""

import os
from pathlib import Path

import pytest

REQUIRED = os.environ.get("PUPPETLINE_TEST_REQUIRE") == "1"
"""Set where everything is known to be there: what would be skipped fails instead."""


def missing(reason: str) -> None:
    """Skip the test, or fail it where nothing may be missing."""
    if REQUIRED:
        pytest.fail(f"{reason}, and PUPPETLINE_TEST_REQUIRE=1 forbids skipping", pytrace=False)
    pytest.skip(reason)


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of real logs and meshes, which cannot be shipped with the project."""
    folder = os.environ.get("PUPPETLINE_TEST_DATA")
    if not folder or not Path(folder).is_dir():
        missing("real recordings and meshes are not here (PUPPETLINE_TEST_DATA names their folder)")
    return Path(str(folder))


@pytest.fixture(scope="session")
def real_logs(real_data: Path) -> Path:
    return real_data / "logs"
