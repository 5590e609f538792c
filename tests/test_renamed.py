"""Names of before are still there for one minor version, and say what they are called now."""

import importlib
import importlib.metadata
import inspect
import re
import warnings

import pytest

PACKAGES = ("jaxgear", "jaxgear.scene", "fem_prep", "optimise")
GONE = (0, 17)
RENAMED = [
    (package, old, new)
    for package in PACKAGES
    for old, new in importlib.import_module(package)._RENAMED.items()
]


@pytest.mark.parametrize(("package", "old", "new"), RENAMED)
def test_an_old_name_is_the_new_one_and_says_so(package, old, new):
    module = importlib.import_module(package)
    words = f"{package}.{old} is called {package}.{new} now: the old name goes with version 0.17."
    # Shape checks, which tests put around functions, would be who asks.
    asked = inspect.unwrap(module.__getattr__)
    with pytest.warns(DeprecationWarning, match=f"^{re.escape(words)}$") as told:
        found = asked(old)
    (warning,) = told
    # The place of who asks, and not of the package.
    assert warning.filename == __file__
    assert found is getattr(module, new)


@pytest.mark.parametrize("package", PACKAGES)
def test_names_of_now_say_nothing_and_old_ones_are_not_listed(package):
    module = importlib.import_module(package)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in module.__all__:
            assert getattr(module, name) is not None
    assert not set(module._RENAMED) & {*module.__all__, *dir(module)}
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = module.no_such_name


def test_old_names_go_when_they_should():
    version = tuple(map(int, importlib.metadata.version("jaxgear").split(".")[:2]))
    assert version < GONE or not RENAMED
