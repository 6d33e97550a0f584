import pytest

from capture.libraries import NotInstalledError, import_error, load_error
from puppetline.errors import SourceError


@pytest.mark.parametrize(
    ("statement", "kind"),
    [
        ("import no_such_module", NotInstalledError),
        ("import no_such_module.part", NotInstalledError),
        ("import a_module", SourceError),  # it imports a missing module
        ("import a_module.no_such_part", SourceError),
        ("from an_empty_module import name", SourceError),
    ],
)
def test_a_module_is_not_installed_only_if_it_is_the_missing_one(tmp_path, monkeypatch, statement, kind):
    (tmp_path / "a_module.py").write_text("import no_such_requirement")
    (tmp_path / "an_empty_module.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ImportError) as caught:
        exec(statement)
    assert import_error(statement.split()[1].partition(".")[0], caught.value) is kind


@pytest.mark.parametrize(("library", "kind"), [("c", SourceError), ("nosuchthing", NotInstalledError)])
def test_a_library_is_installed_if_the_system_finds_it(library, kind):
    assert load_error(library) is kind
