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


def test_a_shared_library_that_a_module_misses_is_named_with_its_package(tmp_path, monkeypatch):
    reason = "libusb-1.0.so.0: cannot open shared object file: No such file or directory"
    (tmp_path / "a_sensor_module.py").write_text(f"raise ImportError({reason!r})")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(SourceError) as caught:
        load_module("a_sensor_module", "here", found="none", expected="one", fix="Install it.")
    assert type(caught.value) is SourceError  # the module itself is installed
    assert (caught.value.found, caught.value.expected, caught.value.fix) == (
        f"none ({reason})",
        "libusb-1.0.so.0, which a_sensor_module requires",
        "Install it: apt install libusb-1.0-0 on Debian and Ubuntu.",
    )


@pytest.mark.parametrize(("library", "kind"), [("c", SourceError), ("nosuchthing", NotInstalledError)])
def test_a_library_is_installed_if_the_system_finds_it(library, kind):
    assert load_error(library) is kind
