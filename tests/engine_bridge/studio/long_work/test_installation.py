"""Extras that the page installs with pip."""

import sys

import pytest

from engine_bridge.studio.long_work import installation
from puppetline.errors import ServiceError

from ...refusals import refused


@pytest.fixture
def pip(monkeypatch, tmp_path):
    """Replace pip with a program that prints its arguments as pip prints packages."""

    def be(code):
        program = tmp_path / "pip.py"
        program.write_text(
            "import sys\nfor each in sys.argv[1:]:\n    if '=' in each: print('Collecting', each, flush=True)\n"
            f"print('Installing collected packages')\nprint('ERROR: no network')\nsys.exit({code})\n"
        )
        wrapper = tmp_path / "python"
        wrapper.write_text(f'#!/bin/sh\nshift 2\nexec "{sys.executable}" "{program}" "$@"\n')
        wrapper.chmod(0o755)
        monkeypatch.setattr(installation.sys, "executable", str(wrapper))

    return be


def test_the_packages_of_an_extra_are_installed_with_progress(pip, monkeypatch):
    monkeypatch.setattr(
        installation, "requires", lambda _: ["numpy>=1", 'av>=14; extra == "film"', 'x==2; extra == "sound"']
    )
    pip(0)
    steps = []
    installation.install_extra("film", lambda *step: steps.append(step))
    assert steps == [("Downloading", pytest.approx(1 / 3)), ("Installing", 0.97)]


def test_an_error_of_pip_is_told(pip):
    pip(1)
    error = refused(ServiceError, installation.install_extra, "camera", lambda *_: None)
    assert error.found.endswith("ERROR: no network")


def test_an_extra_is_installed_if_its_modules_are_found(monkeypatch):
    monkeypatch.setattr(installation, "MODULES", {"film": ("json",), "camera": ("json", "no_such_module")})
    assert installation.is_installed("film")
    assert not installation.is_installed("camera")
