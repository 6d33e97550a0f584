import pytest

from capture.libraries import NotInstalledError, load_error, load_module
from puppetline.errors import SourceError


@pytest.mark.parametrize(
    ("module", "kind"),
    [
        ("no_such_module", NotInstalledError),
        ("no_such_module.part", NotInstalledError),
        ("a_module", SourceError),  # it imports a missing module
        ("an_empty_module.no_such_part", SourceError),
    ],
)
def test_a_module_is_not_installed_only_if_it_is_the_missing_one(tmp_path, monkeypatch, module, kind):
    (tmp_path / "a_module.py").write_text("import no_such_requirement")
    (tmp_path / "an_empty_module.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(SourceError, match=r"^here: found none \(No module .*\); expected one\. In") as caught:
        load_module(module, "here", found="none", expected="one", fix="Install it.")
    assert type(caught.value) is kind


@pytest.mark.parametrize(("library", "kind"), [("c", SourceError), ("nosuchthing", NotInstalledError)])
def test_a_library_is_installed_if_the_system_finds_it(library, kind):
    assert load_error(library) is kind
