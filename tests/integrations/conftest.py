"""The service that engines talk to, as its own tests start it: the real process, on free ports, with a small figure."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest

BRIDGE = Path(__file__).parents[1] / "engine_bridge"


def load(path: Path) -> ModuleType:
    spec = spec_from_file_location(f"integrations_{path.parent.name}", path)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


figure = load(BRIDGE / "conftest.py")
own_cache, new_glb = figure.own_cache, figure.new_glb
make_shape, blob, blob_file, write_puppet, blob_puppet, blob_rig, limbed_puppet = (
    figure.make_shape,
    figure.blob,
    figure.blob_file,
    figure.write_puppet,
    figure.blob_puppet,
    figure.blob_rig,
    figure.limbed_puppet,
)
standing, dance, frames, record, take = figure.standing, figure.dance, figure.frames, figure.record, figure.take

live = load(BRIDGE / "service" / "conftest.py")
serve, serve_module, listen = live.serve, live.serve_module, live.listen
sender, free_port, kung_fu = live.sender, live.free_port, live.kung_fu


@pytest.fixture(scope="session")
def token_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("token") / "token"
    path.write_text("correct-horse-battery-staple")
    path.chmod(0o600)
    return path
